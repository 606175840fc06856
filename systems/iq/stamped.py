"""Clocks from the time stamps of blocks of samples, some of which are false.

A receiver counts samples with an oscillator of its own; GPS says when some of them were taken. Between two stamps that
fit the count no sample was lost. A stamp that does not fit is false where the ones on both sides of it fit each other,
and a gap where the later ones fit each other but not the earlier ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

__all__ = ["WEEK", "Clock", "Dated", "clocks"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

WEEK = 604800.0
_NEAR = 1e-3  # relative; how well a file's own sample rate is known
_STEP = 4e-6  # s; what the stamps of neighbours may be off each other
_WORST = 5e-6  # s; what a clock that was set by GPS may leave
_BENT = 5e-7  # s; largest residual up to which the rate is taken as constant
_FEWEST = 10  # stamps that make a clock
_KNOT = 10.0  # s; between the points at which a rate may change


@dataclass(frozen=True, eq=False)
class Clock:
    """When samples were taken: a line, and what it leaves of slow changes.

    Attributes
    ----------
    offset : float
        Time of sample 0 on the line [s].
    sample_rate : float
        [Hz]
    knots, correction : ndarray, shape (k,)
        Samples, and what is added to the line there [s]; linear between them. Empty: nothing.
    """

    offset: float
    sample_rate: float
    knots: Array
    correction: Array

    def _added(self, place: Array) -> Array:
        if not self.knots.size:
            return np.zeros_like(place)
        return np.interp(place, self.knots, self.correction)

    def time(self, place: Array) -> Array:
        """Return the times [s] of samples, which need not be whole."""
        return self.offset + place / self.sample_rate + self._added(place)

    def place(self, time: Array) -> Array:
        """Return the samples of times [s]; the rate of the corrections, below 1e-6, is neglected squared."""
        line = (time - self.offset) * self.sample_rate
        return line - self.sample_rate * self._added(line - self.sample_rate * self._added(line))

    def from_sample(self, first: int) -> Clock:
        """Return the clock that counts from a later sample."""
        return replace(self, offset=self.offset + first / self.sample_rate, knots=self.knots - first)


@dataclass(frozen=True, eq=False)
class Dated:
    """Blocks on one clock.

    Attributes
    ----------
    begin, end : int
        The first block, and the one after the last.
    clock : Clock
    start, stop : float
        When the first of them, and the last of them, begins [s].
    residual : ndarray
        Stamps minus clock [s], of those that are used.
    """

    begin: int
    end: int
    clock: Clock
    start: float
    stop: float
    residual: Array


def clocks(stamps: Array, first: Integers, claimed: float) -> list[Dated]:
    """Return the clocks of a recording in the order of its samples.

    Parameters
    ----------
    stamps : ndarray, shape (k,)
        GPS second of the week of each block's first sample [s].
    first : ndarray of int, shape (k,)
        Number of that sample.
    claimed : float
        Sample rate, to within a thousandth [Hz].

    Raises
    ------
    ValueError
        If there are too few stamps, or none are those of a steady clock.
    """
    if stamps.size < _FEWEST:
        raise ValueError(f"{stamps.size} stamps are not allowed; at least {_FEWEST}")
    # whatever week the others are in
    time = stamps - WEEK * np.round((stamps - np.median(stamps)) / WEEK)
    pace = np.diff(time) / np.maximum(np.diff(first), 1)
    usual = pace[np.abs(pace * claimed - 1) < _NEAR]
    if usual.size < _FEWEST - 1:
        raise ValueError(f"they are not those of a steady clock of about {claimed:g} Hz; {usual.size + 1} are at most")
    linked = np.abs(np.diff(time) - np.median(usual) * np.diff(first)) < _STEP
    edges = np.flatnonzero(np.diff(np.concatenate([[0], linked, [0]]).astype(int)))
    runs = [(int(a), int(b) + 1) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a + 1 >= _FEWEST]
    if not runs:
        off = 1e6 * np.median(np.abs(np.diff(time) - np.median(usual) * np.diff(first)))
        raise ValueError(f"{off:.3g} us off a steady clock are not allowed; at most {1e6 * _STEP:g} us")
    groups: list[list[tuple[int, int]]] = []
    for run in runs:
        if groups and abs(_apart(time, first, groups[-1][-1], run)) < _WORST:
            groups[-1].append(run)
        else:
            groups.append([run])
    return _in_order([_dated(time, first, group) for group in groups])


def _line(time: Array, first: Array) -> tuple[float, float]:
    """Return the time of sample 0 and of one sample, by least squares."""
    middle = first.mean()
    slope, offset = np.polyfit(first - middle, time - time[0], 1)
    return float(time[0] + offset - slope * middle), float(slope)


def _apart(time: Array, first: Integers, one: tuple[int, int], other: tuple[int, int]) -> float:
    """Return by how much the clock of a run is ahead of that of an earlier one, halfway between them [s]."""
    reach = 20 * _FEWEST
    before, after = slice(max(one[0], one[1] - reach), one[1]), slice(other[0], min(other[1], other[0] + reach))
    place = 0.5 * (first[one[1] - 1] + first[other[0]])
    (a, p), (b, q) = (_line(time[part], first[part].astype(float)) for part in (before, after))
    return (b + q * place) - (a + p * place)


def _dated(time: Array, first: Integers, group: Sequence[tuple[int, int]]) -> Dated:
    """Return the clock of runs that belong together."""
    used = np.concatenate([np.arange(*run) for run in group])
    place, when = first[used].astype(float), time[used]
    offset, slope = _line(when, place)
    residual = when - (offset + slope * place)
    knots = correction = np.zeros(0)
    if np.abs(residual).max() > _BENT:
        count = max(2, int(np.ceil((when[-1] - when[0]) / _KNOT)) + 1)
        knots = np.linspace(place[0], place[-1], count)
        # least squares with hat functions about the knots
        hats = np.stack([np.interp(place, knots, one) for one in np.eye(count)], axis=-1)
        correction = np.linalg.lstsq(hats, residual, rcond=None)[0]
        residual = residual - hats @ correction
    if np.abs(residual).max() > _WORST:
        raise ValueError(
            f"{1e6 * np.abs(residual).max():.3g} us off a steady clock are not allowed; at most {1e6 * _WORST:g} us"
        )
    clock = Clock(offset, 1 / slope, knots, correction)
    start, stop = clock.time(place[[0, -1]])
    return Dated(group[0][0], group[-1][1], clock, float(start), float(stop), residual)


def _in_order(found: list[Dated]) -> list[Dated]:
    """Return those that follow each other in time; where a clock was set back, the longer ones."""
    kept: list[Dated] = []
    for one in sorted(found, key=lambda part: part.begin - part.end):
        if all((one.stop < other.start) if one.begin < other.begin else (other.stop < one.start) for other in kept):
            kept.append(one)
    return sorted(kept, key=lambda part: part.begin)
