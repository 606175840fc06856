"""Which rows of a pass are of the satellite: not the acquisition and loss at its ends, nor what is far off within."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.identification.candidates import Heard, passes_of
from quietfix.diagrams.readers.doppler.received import Received

__all__ = ["used_rows"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_POINTS = 10  # blocks that trial curves go through
_BLOCKS = 100  # of a pass, whose medians the curves are judged by
_SINGULAR = 1e-6  # determinant of columns of size 1
_FAR = 6.0  # robust sigmas
_SETTLED = 4.0
_SHARE = 0.1  # of rows that may be far off where the satellite is heard
_FEWEST = 10  # rows
_TO_SIGMA = 1.4826  # of a median absolute deviation, for Gaussian errors


def used_rows(received: Received, measured: Array, objects: Sequence[Heard]) -> tuple[Flags, list[str]]:
    """Return which rows are used, and notes on all others.

    Of each pass and object the curve of constant, slope, curvature and a shift along the orbit with the least median
    residual of blocks is sought among those through four of ten blocks (least median of squares; Rousseeuw, 1984: up
    to half of the rows may be anything). Of the object with the smallest one, rows further off than 6 robust sigmas
    are bad; acquisition ends, and loss begins, where no more than one in ten rows is.

    Parameters
    ----------
    received : Received
    measured : ndarray, shape (rows,)
        Range rate as received [m/s].
    objects : sequence of Heard
        At least one.
    """
    number = passes_of(received.times)
    used = np.zeros(measured.size, dtype=bool)
    notes: list[str] = []
    for k in range(int(number[-1]) + 1):
        rows = np.flatnonzero(number == k)
        if rows.size < _FEWEST:
            notes.append(f"{_span(received, rows)}: {rows.size} rows before a pause are left out")
            continue
        times = received.times[rows]
        lefts = [(measured[rows] - one.range_rate[rows], one.slope[rows]) for one in objects]
        curves = [_curve(times, *left) for left in lefts]
        best = min(range(len(curves)), key=lambda i: curves[i][0])
        rest = _about(times, *lefts[best], curves[best][1])
        good = _refined(rest)
        first, last = _settled(rest, good, *_ends(good))
        used[rows[first:last]] = good[first:last]
        notes += _told(received, rows, good, first, last)
    return used, notes


def _basis(times: Array, slope: Array) -> Array:
    scaled = 2 * (times - times[0]) / max(times[-1] - times[0], 1e-9) - 1
    return np.stack([np.ones_like(scaled), scaled, scaled**2, slope], axis=1)


def _curve(times: Array, left: Array, slope: Array) -> tuple[float, Array]:
    """Return the median residual of blocks about the best curve, and that curve's coefficients."""
    edges = np.linspace(0, times.size, min(_BLOCKS, times.size) + 1).astype(int)
    basis = np.add.reduceat(_basis(times, slope), edges[:-1]) / np.diff(edges)[:, None]
    value = np.array([np.median(left[a:b]) for a, b in pairwise(edges)])
    picked = np.unique(np.linspace(0, value.size - 1, _POINTS + 2)[1:-1].astype(int))
    trials = np.array(list(combinations(picked, 4)))
    scaled = basis / np.maximum(np.abs(basis).max(axis=0), 1e-9)
    sound = np.abs(np.linalg.det(scaled[trials])) > _SINGULAR
    if not sound.any():
        return float(np.median(np.abs(value))), np.zeros(4)
    fits = np.linalg.solve(basis[trials[sound]], value[trials[sound]][..., None])[..., 0]
    medians = np.median(np.abs(value - fits @ basis.T), axis=1)
    best = int(np.argmin(medians))
    return float(medians[best]), fits[best]


def _about(times: Array, left: Array, slope: Array, curve: Array) -> Array:
    """Return residuals of all rows about a curve, after one step of the biweight from it."""
    basis = _basis(times, slope)
    rest = left - basis @ curve
    weight = np.clip(1 - (rest / max(_FAR * _scale(rest), 1e-9)) ** 2, 0, None)
    fit = np.linalg.lstsq(weight[:, None] * basis, weight * left, rcond=None)[0]
    about: Array = left - basis @ fit
    return about


def _scale(rest: Array) -> float:
    return _TO_SIGMA * float(np.median(np.abs(rest)))


def _refined(rest: Array) -> Flags:
    """Return which rows are no further off than 6 robust sigmas of those that are not."""
    good = np.abs(rest) <= _FAR * _scale(rest)
    for _ in range(3):
        good = np.abs(rest) <= _FAR * max(_scale(rest[good]), 1e-9)
    return good


def _ends(good: Flags) -> tuple[int, int]:
    """Return the first row of the satellite and the one after the last."""
    width = max(5, good.size // 50)
    bad = np.concatenate([[0], np.cumsum(~good)])
    start = np.arange(good.size - width + 1)
    quiet = bad[start + width] - bad[start] <= _SHARE * width
    first = np.flatnonzero(quiet & good[: quiet.size])
    last = np.flatnonzero(quiet & good[width - 1 :])
    if not first.size or not last.size:
        return 0, good.size
    return int(first[0]), int(last[-1]) + width


def _settled(rest: Array, good: Flags, first: int, last: int) -> tuple[int, int]:
    """Return the ends without what still settles there: medians of a few rows 4 robust sigmas of such medians off."""
    width = max(3, good.size // 200)
    count = (last - first) // width
    if count < _FEWEST:
        return first, last
    medians = np.median(rest[first : first + count * width].reshape(count, width), axis=1)
    calm = np.flatnonzero(np.abs(medians) <= _SETTLED * _scale(medians))
    return first + width * int(calm[0]), last if calm[-1] == count - 1 else first + width * (int(calm[-1]) + 1)


def _span(received: Received, rows: NDArray[np.int64]) -> str:
    return f"lines {received.lines[rows[0]]} to {received.lines[rows[-1]]}"


def _told(received: Received, rows: NDArray[np.int64], good: Flags, first: int, last: int) -> list[str]:
    """Return notes on the rows of a pass that are left out."""
    notes = []
    times = received.times
    if first:
        span = times[rows[first]] - times[rows[0]]
        notes.append(f"{_span(received, rows[:first])} are left out: the first {span:.1f} s, before the signal is held")
    if last < rows.size:
        span = times[rows[-1]] - times[rows[last - 1]]
        notes.append(f"{_span(received, rows[last:])} are left out: the last {span:.1f} s, after it is lost")
    within = int(np.count_nonzero(~good[first:last]))
    if within:
        notes.append(f"{within} rows within are left out: more than {_FAR:g} robust sigmas off what is around them")
    if 2 * np.count_nonzero(good[first:last]) < rows.size:
        notes.append("these are more than half of a pass: whatever is said below, look at the recording first")
    return notes
