"""Tables on the terminal, as wide as it is; 140 columns into a file or a pipe."""

from __future__ import annotations

import sys
from collections.abc import Mapping

from rich.console import Console
from rich.table import Table

__all__ = ["number", "print_table", "with_interval"]

_PIPE_WIDTH = 140


def print_table(table: Table) -> None:
    """Print a table to standard output."""
    Console(width=None if sys.stdout.isatty() else _PIPE_WIDTH).print(table)


def with_interval(entry: Mapping[str, float | None]) -> str:
    """Return a value with its interval in brackets, from ``{"value", "low", "high"}``."""
    if entry["value"] is None:
        return "-"
    return f"{number(entry['value'])} ({number(entry['low'])}-{number(entry['high'])})"


def number(value: float | None) -> str:
    """Return a number with about three digits; a dash for none."""
    if value is None:
        return "-"
    if abs(value) >= 1e6:
        return f"{value:.2g}".replace("e+0", "e").replace("e+", "e")
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"
