"""A progress bar that appears only for what takes longer than a second."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any

from quietfix.diagrams.console.compiling import show_compiling
from quietfix.diagrams.console.terminal import live

__all__ = ["Progress"]

_PATIENCE = 1.0  # s


class Progress:
    """Context manager; call `update` as often as convenient.

    Parameters
    ----------
    label : str
        What is going on.
    total : float
        Value of `update` at which it is done.
    shown : bool
        False: do nothing. The bar goes to standard error, and only to a terminal
        whose lines can be overwritten.
    """

    def __init__(self, label: str, total: float, shown: bool = True) -> None:
        self._label, self._total = label, total
        self._shown = shown and live(sys.stderr)
        self._began = time.monotonic()
        self._bar: Any = None
        self._task: Any = None

    def update(self, done: float) -> None:
        """Say how far it is."""
        if not self._shown:
            return
        if self._bar is None:
            if time.monotonic() - self._began < _PATIENCE:
                return
            from rich.console import Console
            from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
            from rich.progress import Progress as Bar

            self._bar = Bar(
                TextColumn("{task.description}"),
                BarColumn(),
                TextColumn("{task.percentage:3.0f} %"),
                TimeRemainingColumn(),
                console=Console(stderr=True),
                transient=True,
            )
            self._bar.start()
            self._task = self._bar.add_task(self._label, total=self._total)
        self._bar.update(self._task, completed=done)

    def __enter__(self) -> Progress:
        """Begin."""
        if self._shown:
            show_compiling()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Take the bar away."""
        if self._bar is not None:
            self._bar.stop()
