"""Every object of a file as a station would have heard it: range rates and their change along the orbit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from diagrams.identification.prediction import elevations, satellite_path, shifts_of
from diagrams.readers.doppler.elements import Elements
from diagrams.readers.doppler.received import Received

__all__ = ["Heard", "heard", "passes_of", "predicted", "time_sigma"]

Array = NDArray[np.float64]

_PAUSE = 1200.0  # s without a row: another pass
_GRID, _COARSE = 2.0, 20.0  # s; a cubic spline on the first is within 1 mm/s
_HALF = 0.5  # s, of the difference that is the derivative along the orbit
_SPEED = 7.6e3  # m/s, of low orbits
_AT_EPOCH, _PER_DAY = 1e3, 1.5e3  # m along the track (Vallado and others, AIAA 2006-6753, and Kelso, AAS 07-127)


@dataclass(frozen=True, eq=False)
class Heard:
    """An object at the times of the rows.

    Attributes
    ----------
    elements : Elements
    age : float
        Days from the epoch of its elements to the first row.
    range_rate : ndarray, shape (rows,)
        As its elements say [m/s].
    slope : ndarray, shape (rows,)
        Change with the time that it is ahead of them [m/s^2].
    highest : float
        Elevation [deg].
    """

    elements: Elements
    age: float
    range_rate: Array
    slope: Array
    highest: float


def passes_of(times: Array) -> NDArray[np.int64]:
    """Return the number of the pass of every row: another one after 20 minutes without a row."""
    return np.cumsum(np.diff(times, prepend=times[0]) > _PAUSE)


def time_sigma(age: float) -> float:
    """Return what elements may be off along the track, as a time [s]: 1 km, and 1.5 km per day of age.

    At 7.6 km/s; a standard deviation for low orbits.
    """
    return float(np.hypot(_AT_EPOCH, _PER_DAY * age) / _SPEED)


def predicted(
    elements: Elements, received: Received, station: Array, ahead: float
) -> tuple[Array, Array, Array] | None:
    """Return range rates [m/s], their slopes [m/s^2] and elevations [rad] at the rows; None where SGP4 fails."""
    number = passes_of(received.times)
    found = np.empty((3, received.times.size))
    for k in range(int(number[-1]) + 1):
        rows = number == k
        times = received.times[rows]
        count = max(int((times[-1] - times[0]) / _GRID) + 2, 5)
        grid = np.linspace(times[0], max(times[-1], times[0] + 1.0), count)
        paths = [
            satellite_path(elements.satellite, received.second, received.rest, grid, ahead + step)
            for step in (0.0, -_HALF, _HALF)
        ]
        if any(path is None for path in paths):
            return None
        rates = [shifts_of(path, station) for path in paths if path is not None]
        height = elevations(paths[0], station) if paths[0] is not None else grid
        table = np.stack([rates[0], (rates[2] - rates[1]) / (2 * _HALF), height])
        found[:, rows] = CubicSpline(grid, table, axis=1)(times)
    return found[0], found[1], found[2]


def heard(elements: Sequence[Elements], received: Received, station: Array) -> tuple[list[Heard], list[str]]:
    """Return the objects that are over the horizon at any time, and notes on the others.

    Of an object that is there twice the elements of the epoch that is nearest count.
    """
    began = received.second + received.rest
    nearest: dict[str, Elements] = {}
    for one in elements:
        before = nearest.get(one.number)
        if before is None or abs(one.epoch - began) < abs(before.epoch - began):
            nearest[one.number] = one
    coarse = _coarse(received.times)
    found: list[Heard] = []
    failed = below = 0
    for one in nearest.values():
        path = satellite_path(one.satellite, received.second, received.rest, coarse)
        if path is None:
            failed += 1
            continue
        if elevations(path, station).max() <= 0:
            below += 1
            continue
        at_rows = predicted(one, received, station, 0.0)
        if at_rows is None:
            failed += 1
            continue
        found.append(Heard(one, (began - one.epoch) / 86400.0, at_rows[0], at_rows[1], np.degrees(at_rows[2].max())))
    notes = [f"{below} of {len(nearest)} objects are below the horizon all the time"] if below else []
    notes += [f"{failed} of {len(nearest)} objects: SGP4 cannot tell where they are then"] if failed else []
    return found, notes


def _coarse(times: Array) -> Array:
    number = passes_of(times)
    parts = []
    for k in range(int(number[-1]) + 1):
        mine = times[number == k]
        parts.append(np.linspace(mine[0], mine[-1], int((mine[-1] - mine[0]) / _COARSE) + 2))
    return np.concatenate(parts)
