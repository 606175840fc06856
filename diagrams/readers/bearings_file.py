"""Bearings from a CSV file: what is in it, and what is wrong with it."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.angle_wrapping import wrap
from quietfix.systems.angles.bearing import from_compass
from quietfix.systems.files import Unreadable, read_text

__all__ = ["Bearings", "read_bearings"]

Array = NDArray[np.float64]

_LOCAL, _GEODETIC = ("x_m", "y_m"), ("latitude_deg", "longitude_deg")
_LATEST, _FARTHEST = 1e12, 1e8  # s, seconds since 1970 too; m, more than around the Earth
_LARGEST_FILE = 16_000_000  # bytes: some 300,000 bearings
_AXIS, _ECCENTRICITY2 = 6378137.0, 6.69437999014e-3  # WGS-84


@dataclass(frozen=True)
class Bearings:
    """Bearings of one target.

    Attributes
    ----------
    time : ndarray, shape (k,)
        [s]
    place : ndarray, shape (k, 2)
        East and north of the origin [m].
    azimuth : ndarray, shape (k,)
        Counter-clockwise from east [rad].
    sigma : ndarray, shape (k,)
        Standard deviations [rad]; NaN where the file does not say.
    origin : tuple of float, optional
        Latitude and longitude of the origin [rad]; None where places came in metres.
    """

    time: Array
    place: Array
    azimuth: Array
    sigma: Array
    origin: tuple[float, float] | None = None

    def spread(self, sigma: float) -> Array:
        """Return standard deviations (k,) [rad], `sigma` where the file does not say."""
        return np.where(np.isfinite(self.sigma), self.sigma, sigma)

    def take(self, rows: NDArray[np.intp]) -> Bearings:
        """Return some of the bearings."""
        return Bearings(self.time[rows], self.place[rows], self.azimuth[rows], self.sigma[rows], self.origin)

    def degrees(self, position: Array) -> tuple[Array, Array]:
        """Return latitude and longitude [deg] of positions (..., 2)."""
        assert self.origin is not None
        north, east = _scales(self.origin[0])
        return (
            np.degrees(self.origin[0] + position[..., 1] / north),
            np.degrees(self.origin[1] + position[..., 0] / east),
        )


def _scales(latitude: float) -> tuple[float, float]:
    """Return metres per radian of latitude and of longitude, on the ellipsoid's surface."""
    w = 1 - _ECCENTRICITY2 * math.sin(latitude) ** 2
    return _AXIS * (1 - _ECCENTRICITY2) / w**1.5, _AXIS * math.cos(latitude) / math.sqrt(w)


def read_bearings(path: Path | str) -> Bearings:
    """Read a CSV file of bearings.

    The first line names the columns, in any order: ``time_s``; ``x_m`` and ``y_m`` (east and north), or
    ``latitude_deg`` and ``longitude_deg``; ``bearing_deg``, clockwise from north, 0 to 360; ``sigma_deg``, the
    bearing's standard deviation, which may be empty where it is not known (then in all lines). Lines that begin with
    ``#`` are comments. Latitude and longitude are laid on a plane through their mean: good for some tens of kilometres.

    Raises
    ------
    UserError
        Naming line, column, value and what is allowed.
    """
    file = Path(path)
    try:
        text = read_text(file, _LARGEST_FILE, encoding="utf-8-sig")
    except Unreadable as error:
        raise UserError(f"bearings: {error}") from error
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    if not lines:
        raise UserError(f"bearings: {file} is empty; a line of column names and at least two bearings are needed")
    header = _cells(file, *lines[0])
    places = _GEODETIC if set(_GEODETIC) & set(header) else _LOCAL
    missing = [name for name in ("time_s", *places, "bearing_deg", "sigma_deg") if name not in header]
    if missing:
        raise UserError(
            f"bearings: {file} has no column {', '.join(missing)}; time_s, x_m and y_m (or latitude_deg and "
            "longitude_deg), bearing_deg and sigma_deg are needed"
        )
    table = np.array([_row(file, number, line, header, places) for number, line in lines[1:]]).reshape(-1, 5)
    if len(table) < 2:
        raise UserError(f"bearings: {file} has {len(table)} bearing(s); a single one locates nothing, 2 are needed")
    time, first, second, bearing, sigma = table.T
    backwards = np.flatnonzero(np.diff(time) < 0)
    if backwards.size:
        raise UserError(f"bearings: {file}: time_s falls from {time[backwards[0]]:g} to {time[backwards[0] + 1]:g}")
    if np.isnan(sigma).any() and not np.isnan(sigma).all():
        raise UserError(f"bearings: {file}: sigma_deg is empty in some lines; give it in all or in none")
    origin = None
    if places == _GEODETIC:
        origin = math.radians(first.mean()), math.radians(second.mean())
        north, east = _scales(origin[0])
        turned = wrap(np.radians(second) - origin[1])
        first, second = turned * east, (np.radians(first) - origin[0]) * north
    place = np.stack([first, second], axis=-1)
    if np.ptp(place, axis=0).max() == 0:
        raise UserError(f"bearings: {file}: all positions are equal; bearings from at least two are needed")
    azimuth = from_compass(bearing)
    if np.abs(np.sin(azimuth - azimuth[0])).max() < 1e-6:
        raise UserError(f"bearings: {file}: all bearings are parallel; lines that cross are needed")
    return Bearings(time, place, azimuth, np.radians(sigma), origin)


def _cells(file: Path, number: int, line: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line]))]
    except csv.Error as error:  # a cell of more than 131072 characters, say
        raise UserError(f"bearings: {file}, line {number}: it cannot be read ({error})") from error


def _row(file: Path, number: int, line: str, header: list[str], places: tuple[str, str]) -> list[float]:
    cells = _cells(file, number, line)
    if len(cells) != len(header):
        raise UserError(f"bearings: {file}, line {number}: {len(cells)} cells are given; {len(header)} are needed")
    row = dict(zip(header, cells, strict=True))
    limits = {
        "time_s": (-_LATEST, _LATEST, f"a number, at most {_LATEST:g} in size"),
        "x_m": (-_FARTHEST, _FARTHEST, f"a number, at most {_FARTHEST:g} in size"),
        "y_m": (-_FARTHEST, _FARTHEST, f"a number, at most {_FARTHEST:g} in size"),
        "latitude_deg": (-89.0, 89.0, "-89 to 89"),
        "longitude_deg": (-180.0, 360.0, "-180 to 360"),
        "bearing_deg": (0.0, 360.0, "0 to 360, clockwise from north"),
        "sigma_deg": (1e-12, 180.0, "a number > 0, at most 180, or nothing"),
    }
    values = []
    for name in ("time_s", *places, "bearing_deg", "sigma_deg"):
        least, most, allowed = limits[name]
        if name == "sigma_deg" and not row[name]:
            values.append(math.nan)
            continue
        try:
            value = float(row[name])
        except ValueError:
            value = math.nan
        if not (math.isfinite(value) and least <= value <= most):
            raise UserError(f"bearings: {file}, line {number}: {name} {row[name][:60]!r} is not allowed; {allowed}")
        values.append(value)
    return values
