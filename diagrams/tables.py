"""Tables on the terminal, as wide as it is; 140 columns into a file or a pipe."""

from __future__ import annotations

import sys

from rich.console import Console
from rich.table import Table

__all__ = ["print_table"]

_PIPE_WIDTH = 140


def print_table(table: Table) -> None:
    """Print a table to standard output."""
    Console(width=None if sys.stdout.isatty() else _PIPE_WIDTH).print(table)
