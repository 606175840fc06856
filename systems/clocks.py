"""Clocks: when a block samples.

A clock declares its ticks as Drake events (``declare``) and says which tick an instant is (``index``).
Irregular ticks are one event per stamp with a period longer than any run, so they fire at exactly the stamp.

Two clocks can mean one instant and differ in the last bit: 3 * 0.1 is not 0.3, and Drake then fires twice. So
instants are compared by `same_instant`, and what has been used at the one is not used again at the other.
"""

from __future__ import annotations

import math
from array import array
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Clock", "Driven", "Merged", "Periodic", "Stepped", "Times", "at_ticks", "first_ticks", "same_instant"]

_NEVER_AGAIN = 1e12  # seconds; the period of an event that is meant to fire once
_ROUNDING = 1e-12  # relative; thousands of rounding errors, and less than light needs for 0.3 mm at 1 s


def _slack(time: float) -> float:
    return _ROUNDING * max(1.0, abs(time))


def same_instant(time: float, other: float) -> bool:
    """Return whether two times [s] differ by no more than rounding."""
    apart = abs(time - other)
    return apart <= _ROUNDING or apart <= _ROUNDING * abs(time)  # of every step, so without a call


class Clock(Protocol):
    """When a block samples."""

    def declare(self, how: Callable[[float, float], None]) -> None:
        """Call ``how(period, offset)`` for every Drake event that the clock needs (both in seconds)."""

    def index(self, time: float) -> int | None:
        """Return the index of the tick at `time` [s], or None between ticks."""

    def ticks(self, end: float) -> NDArray[np.float64]:
        """Return all ticks up to and including `end` [s]; rounding may put the last one a bit after `end`."""


def first_ticks(clock: Clock, count: int) -> NDArray[np.float64]:
    """Return the first `count` ticks [s] of a clock, or as many as it has in thirty years."""
    end = 1.0
    while len(clock.ticks(end)) < count and end < 1e9:
        end *= 2
    return clock.ticks(end)[:count]


@dataclass(frozen=True)
class Periodic:
    """Ticks at ``offset + k period``, k = 0, 1, ...

    Parameters
    ----------
    period : float
        Time between ticks [s], > 0.
    offset : float
        First tick [s], >= 0.
    """

    period: float
    offset: float = 0.0

    def __post_init__(self) -> None:
        """Check the arguments."""
        if not (math.isfinite(self.period) and self.period > 0):
            raise ValueError(f"clock period: {self.period} is not allowed; it must be > 0 s")
        if not (math.isfinite(self.offset) and self.offset >= 0):
            raise ValueError(f"clock offset: {self.offset} is not allowed; it must be >= 0 s")

    def declare(self, how: Callable[[float, float], None]) -> None:
        """See `Clock.declare`."""
        how(self.period, self.offset)

    def index(self, time: float) -> int | None:
        """See `Clock.index`."""
        k = round((time - self.offset) / self.period)
        return k if k >= 0 and same_instant(time, self.offset + k * self.period) else None

    def ticks(self, end: float) -> NDArray[np.float64]:
        """See `Clock.ticks`."""
        count = math.floor((end + _slack(end) - self.offset) / self.period) + 1
        return self.offset + self.period * np.arange(max(count, 0), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class Times:
    """Ticks at given stamps.

    Parameters
    ----------
    stamps : array_like, shape (samples,)
        Strictly increasing, >= 0 [s]. Use seconds since the first stamp: UNIX seconds in a double resolve
        only 0.2 microseconds.
    """

    stamps: ArrayLike
    _stamps: NDArray[np.float64] = field(init=False, repr=False)
    _sought: array[float] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Check the arguments."""
        stamps = np.array(self.stamps, dtype=float)
        if stamps.ndim != 1 or stamps.size == 0:
            raise ValueError("clock stamps: a one-dimensional array with at least one stamp is needed")
        if not np.all(np.isfinite(stamps)) or stamps[0] < 0:
            raise ValueError("clock stamps: all must be finite and >= 0 s")
        close = np.diff(stamps) <= 2 * _ROUNDING * np.maximum(1.0, stamps[1:])
        if np.any(close):
            at = int(np.argmax(close))
            raise ValueError(
                f"clock stamps: they must increase strictly, but stamp {at + 1} is {stamps[at + 1]} after {stamps[at]}"
            )
        stamps.setflags(write=False)
        object.__setattr__(self, "_stamps", stamps)
        object.__setattr__(
            self, "_sought", array("d", stamps.tobytes())
        )  # its elements are plain numbers: faster to compare

    def declare(self, how: Callable[[float, float], None]) -> None:
        """See `Clock.declare`."""
        for stamp in self._stamps:
            how(_NEVER_AGAIN, float(stamp))

    def index(self, time: float, last: int | None = None) -> int | None:
        """See `Clock.index`; `last` is the tick before, where that is known."""
        if last is not None and last + 1 < len(self._sought) and self._sought[last + 1] == time:
            return last + 1
        return _find(self._sought, time)

    def ticks(self, end: float) -> NDArray[np.float64]:
        """See `Clock.ticks`."""
        return self._stamps[self._stamps <= end + _slack(end)]


class Stepped(Times):
    """Ticks at given stamps that whoever runs the diagram advances to, one after the other.

    Drake asks every event of every block at every step when it is due: 6.5 ns each, 65 s for a block of 1e5 stamps. So
    there are no events here, and a block looks at every step whether it is at a tick; see `at_ticks`.
    """


class Driven:
    """Ticks that nobody knows before they come: whoever runs the diagram says them, and advances to them.

    Parameters
    ----------
    usual : Clock
        What `ticks` tells of the time to come, for what looks around before a run.
    """

    def __init__(self, usual: Clock) -> None:
        self._usual = usual
        self._said: tuple[tuple[float, int], ...] = ()

    def say(self, *ticks: tuple[float, int]) -> None:
        """Let ticks be at these times [s] with these numbers, and no others."""
        self._said = ticks

    def declare(self, how: Callable[[float, float], None]) -> None:
        """See `Clock.declare`: there are no events, see `at_ticks`."""

    def index(self, time: float) -> int | None:
        """See `Clock.index`."""
        return next((number for tick, number in self._said if same_instant(time, tick)), None)

    def ticks(self, end: float) -> NDArray[np.float64]:
        """See `Clock.ticks`; as they usually are."""
        return self._usual.ticks(end)


def at_ticks(clock: Clock, timed: Callable[[float, float], None], stepped: Callable[[], None]) -> None:
    """Declare what a block does at the ticks of a clock.

    Parameters
    ----------
    clock : Clock
    timed : callable
        ``timed(period, offset)`` declares an event of Drake's.
    stepped : callable
        Declares what is done at every step, if that is at a tick: of a `Stepped` or `Driven` clock.
    """
    if isinstance(clock, Stepped | Driven):
        stepped()
    else:
        clock.declare(timed)


def _find(ticks: array[float], time: float) -> int | None:
    slack = _slack(time)
    k = bisect_left(ticks, time - slack)
    return k if k < len(ticks) and abs(time - ticks[k]) <= slack else None


@dataclass(frozen=True, eq=False)
class Merged:
    """The ticks of several clocks together: what a block uses that reads sensors of different rates.

    Parameters
    ----------
    clocks : sequence of Clock
        At least one. Where two tick at the same instant, up to rounding, it is one tick.
    """

    clocks: Sequence[Clock]
    _known: dict[str, array[float]] = field(init=False, repr=False, default_factory=dict)

    def __post_init__(self) -> None:
        """Check the arguments."""
        if not self.clocks:
            raise ValueError("merged clocks: none is given; at least one is needed")

    def declare(self, how: Callable[[float, float], None]) -> None:
        """See `Clock.declare`."""
        for clock in self.clocks:
            clock.declare(how)

    def index(self, time: float) -> int | None:
        """See `Clock.index`."""
        if all(clock.index(time) is None for clock in self.clocks):
            return None
        known = self._known.get("ticks")
        if known is None or known[-1] <= time:
            # Twice as far as asked for, so that a long run lists its ticks a few times and not at every tick.
            known = self._known["ticks"] = array("d", self.ticks(2 * time + 1.0).tobytes())
        return _find(known, time)

    def ticks(self, end: float) -> NDArray[np.float64]:
        """See `Clock.ticks`."""
        ticks = np.sort(np.concatenate([clock.ticks(end) for clock in self.clocks]))
        new = np.diff(ticks, prepend=-np.inf) > _ROUNDING * np.maximum(1.0, ticks)
        return ticks[new]
