"""Every object of a file as a station would have heard it: range rates and their change along the orbit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from quietfix.diagrams.identification.prediction import elevations, satellite_path, shifts_of
from quietfix.diagrams.readers.doppler.elements import Elements
from quietfix.diagrams.readers.doppler.received import Received

__all__ = ["Heard", "Orbit", "heard", "orbit_of", "passes_of", "predicted", "time_sigma"]

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


@dataclass(frozen=True, eq=False)
class Orbit:
    """A satellite on a grid of times of each pass, for any station.

    Attributes
    ----------
    rows : list of ndarray of bool
        Which rows are of each pass.
    grids : list of ndarray
        Times of the grids [s].
    states : list of (ndarray, ndarray, ndarray)
        There, and half a second behind and ahead along the orbit.
    times : ndarray, shape (rows,)
    """

    rows: list[NDArray[np.bool_]]
    grids: list[Array]
    states: list[tuple[Array, Array, Array]]
    times: Array

    def rates(self, station: Array) -> Array:
        """Return range rates at the rows [m/s], shape (rows,)."""
        return self._at_rows([shifts_of(states[0], station)[None] for states in self.states])[0]

    def all_at(self, station: Array) -> tuple[Array, Array, Array]:
        """Return range rates [m/s], their slopes [m/s^2] and elevations [rad] at the rows."""
        tables = []
        for states in self.states:
            now, before, after = (shifts_of(one, station) for one in states)
            tables.append(np.stack([now, (after - before) / (2 * _HALF), elevations(states[0], station)]))
        found = self._at_rows(tables)
        return found[0], found[1], found[2]

    def _at_rows(self, tables: Sequence[Array]) -> Array:
        found = np.empty((len(tables[0]), self.times.size))
        for rows, grid, table in zip(self.rows, self.grids, tables, strict=True):
            found[:, rows] = CubicSpline(grid, table, axis=1)(self.times[rows])
        return found


def orbit_of(elements: Elements, received: Received, ahead: float) -> Orbit | None:
    """Return where a satellite is that is ahead of its elements by a time [s]; None where SGP4 fails."""
    number = passes_of(received.times)
    rows, grids, states = [], [], []
    for k in range(int(number[-1]) + 1):
        mine = number == k
        times = received.times[mine]
        count = max(int((times[-1] - times[0]) / _GRID) + 2, 5)
        grid = np.linspace(times[0], max(times[-1], times[0] + 1.0), count)
        now, before, after = (
            satellite_path(elements.satellite, received.second, received.rest, grid, ahead + step)
            for step in (0.0, -_HALF, _HALF)
        )
        if now is None or before is None or after is None:
            return None
        rows.append(mine)
        grids.append(grid)
        states.append((now, before, after))
    return Orbit(rows, grids, states, received.times)


def predicted(
    elements: Elements, received: Received, station: Array, ahead: float
) -> tuple[Array, Array, Array] | None:
    """Return range rates [m/s], their slopes [m/s^2] and elevations [rad] at the rows; None where SGP4 fails."""
    orbit = orbit_of(elements, received, ahead)
    return None if orbit is None else orbit.all_at(station)


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
