"""A line that says what is being compiled, on a terminal, while that takes its time."""

from __future__ import annotations

import sys

from quietfix.diagrams.console.terminal import live
from quietfix.systems.kernels.progress import on_compiling

__all__ = ["show_compiling"]

_count = 0


def show_compiling() -> None:
    """From now on, say on standard error what is compiled, on a line that vanishes when it is done."""
    on_compiling(_show)


def _show(name: str) -> None:
    global _count
    if not live(sys.stderr):
        return
    if name:
        _count += 1
        text = f"\r\x1b[Kcompiling numerical kernels, once for this machine: {_count}, {name}"
    else:
        text = "\r\x1b[K"
    sys.stderr.write(text)
    sys.stderr.flush()
