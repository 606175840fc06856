"""A line that says what is being compiled, while that takes its time."""

from __future__ import annotations

import sys

from quietfix.diagrams.console.terminal import live
from quietfix.systems.kernels.progress import on_compiling

__all__ = ["show_compiling"]

_TEXT = "compiling numerical kernels, once for this machine"
_count = 0


def show_compiling() -> None:
    """From now on, say on standard error what is compiled.

    On a terminal that is a line which vanishes when it is done; elsewhere, such as in a log of a batch job, one that is
    written once.
    """
    on_compiling(_show)


def _show(name: str) -> None:
    global _count
    _count += bool(name)
    if not live(sys.stderr):
        if name and _count == 1:
            print(_TEXT, file=sys.stderr, flush=True)
        return
    sys.stderr.write(f"\r\x1b[K{_TEXT}: {_count}, {name}" if name else "\r\x1b[K")
    sys.stderr.flush()
