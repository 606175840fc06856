"""How far a run is: a bar on a terminal for what takes longer than a second, elsewhere a line a minute."""

from __future__ import annotations

import sys
import time
from types import TracebackType
from typing import Any

from quietfix.diagrams.console.compiling import show_compiling
from quietfix.diagrams.console.terminal import live

__all__ = ["Progress"]

_PATIENCE = 1.0  # s, before there is a bar
_EVERY = 60.0  # s, between lines where no line can be overwritten


class Progress:
    """Context manager; call `update` as often as convenient.

    Parameters
    ----------
    label : str
        What is going on.
    total : float
        Value of `update` at which it is done.
    shown : bool
        False: do nothing. What is shown goes to standard error: a bar to a terminal whose lines can be overwritten, and
        a line a minute to all else.
    unit : str
        What is counted, so that it is told how many are done and how many a second; empty: only which share.
    """

    def __init__(self, label: str, total: float, shown: bool = True, unit: str = "") -> None:
        self._label, self._total, self._unit = label, total, unit
        self._shown, self._live = shown, live(sys.stderr)
        self._began = self._said = time.monotonic()
        self._bar: Any = None
        self._task: Any = None

    def update(self, done: float, workers: int | None = None) -> None:
        """Say how far it is, and how many workers there are for it."""
        if not self._shown:
            return
        now = time.monotonic()
        if not self._live:
            if now - self._said >= _EVERY:
                self._said = now
                share = f" {100 * done / self._total:.0f} %" if self._total > 0 and not self._unit else ""
                words = ", ".join(self._words(done, now, workers))
                print(f"quietfix: {self._label}:{share}{' ' * bool(words)}{words}", file=sys.stderr, flush=True)
            return
        if self._bar is None:
            if now - self._began < _PATIENCE:
                return
            self._bar = _bar()
            self._bar.start()
            self._task = self._bar.add_task(self._label, total=self._total, words="")
        words = ", ".join(self._words(done, now, workers))
        self._bar.update(self._task, completed=done, words=words)

    def _words(self, done: float, now: float, workers: int | None) -> list[str]:
        """Return how many are done, how many a second, how long the others take, and who works."""
        took = now - self._began
        words = [f"{int(done)} of {int(self._total)} {self._unit}"] if self._unit else []
        if done > 0 and took > 0:
            if self._unit:
                words.append(f"{done / took:.3g} a second")
            words.append(f"{_clock(took * max(self._total - done, 0) / done)} left")
        if workers is not None:
            words.append(f"{workers} worker{'s' * (workers != 1)}")
        return words

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


def _bar() -> Any:
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bar

    columns = ("{task.description}", None, "{task.percentage:3.0f} %", "{task.fields[words]}")
    shown = [BarColumn() if column is None else TextColumn(column) for column in columns]
    return Bar(*shown, console=Console(stderr=True), transient=True)


def _clock(seconds: float) -> str:
    """Return a time as h:mm:ss or m:ss."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
