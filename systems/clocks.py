"""Clocks: when a block samples.

A clock declares its ticks as Drake events (``declare``) and says which tick an instant is (``index``).
Irregular ticks are one event per stamp with a period longer than any run, so they fire at exactly the stamp.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Clock", "Merged", "Periodic", "Times"]

_NEVER_AGAIN = 1e12  # seconds; the period of an event that is meant to fire once


class Clock(Protocol):
    """When a block samples."""

    def declare(self, how: Callable[[float, float], None]) -> None:
        """Call ``how(period, offset)`` for every Drake event that the clock needs (both in seconds)."""

    def index(self, time: float) -> int | None:
        """Return the index of the tick at `time` [s], or None between ticks."""

    def ticks(self, end: float) -> NDArray[np.float64]:
        """Return all ticks up to and including `end` [s]."""


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
        if k < 0 or abs(self.offset + k * self.period - time) > 1e-9 * self.period:
            return None
        return k

    def ticks(self, end: float) -> NDArray[np.float64]:
        """See `Clock.ticks`."""
        count = math.floor((end - self.offset) / self.period * (1 + 1e-12) + 1e-9) + 1
        return self.offset + self.period * np.arange(max(count, 0))


@dataclass(frozen=True)
class Times:
    """Ticks at given stamps.

    Parameters
    ----------
    stamps : array_like, shape (samples,)
        Strictly increasing, >= 0 [s]. Use seconds since the first stamp: UNIX seconds in a double resolve
        only 0.2 microseconds.
    """

    stamps: ArrayLike
    _stamps: NDArray[np.float64] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the arguments."""
        stamps = np.array(self.stamps, dtype=float)
        if stamps.ndim != 1 or stamps.size == 0:
            raise ValueError("clock stamps: a one-dimensional array with at least one stamp is needed")
        if not np.all(np.isfinite(stamps)) or stamps[0] < 0:
            raise ValueError("clock stamps: all must be finite and >= 0 s")
        if np.any(np.diff(stamps) <= 0):
            at = int(np.argmax(np.diff(stamps) <= 0))
            raise ValueError(
                f"clock stamps: they must increase strictly, but stamp {at + 1} is {stamps[at + 1]} after {stamps[at]}"
            )
        stamps.setflags(write=False)
        object.__setattr__(self, "_stamps", stamps)

    def declare(self, how: Callable[[float, float], None]) -> None:
        """See `Clock.declare`."""
        for stamp in self._stamps:
            how(_NEVER_AGAIN, float(stamp))

    def index(self, time: float) -> int | None:
        """See `Clock.index`; the stamp must be met exactly, which Drake's events do."""
        k = int(np.searchsorted(self._stamps, time))
        return k if k < self._stamps.size and self._stamps[k] == time else None

    def ticks(self, end: float) -> NDArray[np.float64]:
        """See `Clock.ticks`."""
        return self._stamps[self._stamps <= end]


@dataclass(frozen=True)
class Merged:
    """The ticks of several clocks together: what a block uses that reads sensors of different rates."""

    clocks: Sequence[Clock]

    def declare(self, how: Callable[[float, float], None]) -> None:
        """See `Clock.declare`."""
        for clock in self.clocks:
            clock.declare(how)

    def index(self, time: float) -> int | None:
        """Return the number of ticks before `time`, or None where no clock ticks."""
        if all(clock.index(time) is None for clock in self.clocks):
            return None
        return int(np.count_nonzero(self.ticks(time) < time))

    def ticks(self, end: float) -> NDArray[np.float64]:
        """See `Clock.ticks`; ticks that coincide are counted once."""
        return np.unique(np.concatenate([clock.ticks(end) for clock in self.clocks]))
