"""One target: rows that wait for the others of their instant, ticks that were run, and those that are run again."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.live.bench import Moment, Runner, Told
from quietfix.diagrams.live.lines import Heard
from quietfix.diagrams.live.refused import Counted, Refused

__all__ = ["Done", "FollowedTarget", "Outcome", "Tick"]

Array = NDArray[np.float64]

_SAME = 4e-12  # relative; rows as near to each other as this are of one instant, as in a table


@dataclass
class Tick:
    """What was measured at one instant.

    Attributes
    ----------
    time : float
        [s].
    value, scale : ndarray, shape (rows,)
        See `quietfix.systems.sensors.handed_rows.HandedRows.hand`.
    rows : set of int
        Which rows there were, with a value or without.
    heard : float
        When the last of them came, by a clock that never goes back [s].
    """

    time: float
    value: Array
    scale: Array
    rows: set[int] = field(default_factory=set)
    heard: float = 0.0

    def add(self, heard: Heard, now: float) -> None:
        """Add a row.

        Raises
        ------
        Refused
            If it is there already.
        """
        if heard.row in self.rows:
            raise Refused("twice", f"{heard.target} has two rows of the same at {heard.time:.10g} s; the first counts")
        self.rows.add(heard.row)
        self.value[heard.row], self.scale[heard.row] = heard.value, heard.scale
        self.time, self.heard = min(self.time, heard.time), now


@dataclass
class Done:
    """A tick that was run, and what was known before it; None: nothing yet."""

    before: Moment | None
    tick: Tick


@dataclass(frozen=True)
class Outcome:
    """What came out of a tick; `revised`: it is told again, with what came late."""

    target: str
    time: float
    rows: int
    told: Mapping[str, Told]
    revised: bool


def _same(a: float, b: float) -> bool:
    return abs(a - b) <= _SAME * max(1.0, abs(a))


class FollowedTarget:
    """One target.

    Parameters
    ----------
    runner : Runner
    rows : int
        Of the stream of measurements.
    lag : float
        How late a row may be [s]: so long the ticks are kept, to go back and run them again with it.
    refusals : Counted
        Where ticks are counted with which an estimator can do nothing.
    """

    def __init__(self, runner: Runner, rows: int, lag: float, refusals: Counted) -> None:
        self.runner, self._rows, self._lag, self._refusals = runner, rows, lag, refusals
        self.pending: list[Tick] = []
        self.done: deque[Done] = deque()
        self.last: float | None = None
        self.heard = 0.0
        self._dirty: int | None = None

    def add(self, heard: Heard, now: float) -> None:
        """Take a row.

        Raises
        ------
        Refused
            If it is too late, or there twice.
        """
        if self.last is not None and (heard.time < self.last or _same(heard.time, self.last)):
            self._late(heard, now)
        else:
            _tick_at(self.pending, heard.time, self._rows).add(heard, now)
        self.heard = now

    def _late(self, heard: Heard, now: float) -> None:
        assert self.last is not None
        if not self.done or heard.time < self.last - self._lag:
            raise Refused(
                "late",
                f"{heard.target} at {heard.time:.10g} s, when {self.last:.10g} s is done; rows in order, or --lag S to "
                "go back",
            )
        ticks = [one.tick for one in self.done]
        count = len(ticks)
        tick = _tick_at(ticks, heard.time, self._rows)
        at = next(i for i, one in enumerate(ticks) if one is tick)
        tick.add(heard, now)
        if len(ticks) > count:
            self.done.insert(at, Done(self.done[at].before, tick))
        self._dirty = at if self._dirty is None else min(self._dirty, at)

    def ready(self, before: float = np.inf, everything: bool = False) -> Iterator[Outcome]:
        """Run what is complete: ticks that a later one follows, and those of which nothing came since a time.

        Parameters
        ----------
        before : float
            By the clock of `Tick.heard` [s]; infinite: only what later ones follow.
        everything : bool
            Whether nothing more will come.
        """
        if np.isfinite(before) or everything or len(self.pending) > 1:
            yield from self.again()
        while self.pending and (
            len(self.pending) > 1 or everything or (np.isfinite(before) and self.pending[-1].heard <= before)
        ):
            yield self._run(self.pending.pop(0))

    def again(self) -> Iterator[Outcome]:
        """Run the ticks again to which late rows were added, and all after them."""
        if self._dirty is None:
            return
        redo = [self.done.pop() for _ in range(len(self.done) - self._dirty)][::-1]
        self._dirty = None
        self.runner.go_back(redo[0].before)
        for one in redo:
            yield self._run(one.tick, revised=True)

    def _run(self, tick: Tick, revised: bool = False) -> Outcome:
        if self._lag > 0:
            self.done.append(Done(self.runner.moment(), tick))
            while self.done[0].tick.time < tick.time - self._lag:
                self.done.popleft()
        self.last = tick.time
        told = self._stepped(tick)
        return Outcome(self.runner.target, tick.time, len(tick.rows), told, revised)

    def _stepped(self, tick: Tick) -> Mapping[str, Told]:
        try:
            with np.errstate(all="ignore"):  # of values that cannot be used: it is said below
                return self.runner.step(tick.time, tick.value, tick.scale)
        except (ArithmeticError, ValueError) as error:  # such as a noise that is 1e-300 of what is believed
            message = f"{self.runner.target} at {tick.time:.10g} s: it cannot be used ({error})"
            self._refusals.add("unusable", message, len(tick.rows))
            tick.value[:], tick.scale[:] = np.nan, 1.0
            return self.runner.hand_over(tick.value, tick.scale)


def _tick_at(ticks: list[Tick], time: float, rows: int) -> Tick:
    """Return the tick of a time among those in order of time; a new one if there is none."""
    at = len(ticks)
    while at and not _same(ticks[at - 1].time, time) and ticks[at - 1].time > time:
        at -= 1
    if at and _same(ticks[at - 1].time, time):
        return ticks[at - 1]
    tick = Tick(time, np.full(rows, np.nan), np.ones(rows))
    ticks.insert(at, tick)
    return tick
