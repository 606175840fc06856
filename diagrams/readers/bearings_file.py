"""Bearings from a CSV file: what is in it, and what is wrong with it."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.angle_wrapping import wrap
from quietfix.systems.angles.bearing import from_compass
from quietfix.systems.files import Unreadable, read_text

__all__ = ["Bearings", "Target", "read_bearings", "read_targets"]

Array = NDArray[np.float64]

_LOCAL, _GEODETIC = ("x_m", "y_m"), ("latitude_deg", "longitude_deg")
_LATEST, _FARTHEST = 1e12, 1e8  # s, seconds since 1970 too; m, more than around the Earth
_LARGEST_FILE = 16_000_000  # bytes: some 300,000 bearings
_BEARING, _SIGMA = ("bearing_deg", "bearing_rad"), ("sigma_deg", "sigma_rad")
_DELIMITERS = (",", ";", "\t", "|")
_LIMITS = {
    "time_s": (-_LATEST, _LATEST, f"a number, at most {_LATEST:g} in size"),
    "x_m": (-_FARTHEST, _FARTHEST, f"a number, at most {_FARTHEST:g} in size"),
    "y_m": (-_FARTHEST, _FARTHEST, f"a number, at most {_FARTHEST:g} in size"),
    "latitude_deg": (-89.0, 89.0, "-89 to 89"),
    "longitude_deg": (-180.0, 360.0, "-180 to 360"),
    "bearing_deg": (-180.0, 360.0, "0 to 360, clockwise from north, or -180 to 180"),
    "bearing_rad": (-math.pi, 2 * math.pi, "0 to 2 pi, clockwise from north, or -pi to pi"),
    "sigma_deg": (1e-12, 180.0, "a number > 0, at most 180, or nothing"),
    "sigma_rad": (1e-14, math.pi, "a number > 0, at most pi, or nothing"),
}
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


class Target(NamedTuple):
    """What a file says of one target.

    Attributes
    ----------
    name : str
        Empty: the file names none.
    bearings : Bearings
    wrong : str
        Why these bearings cannot locate it; empty: they may.
    """

    name: str
    bearings: Bearings
    wrong: str


def read_bearings(path: Path | str) -> Bearings:
    """Read a file of bearings of one target, see `read_targets`.

    Raises
    ------
    UserError
        As `read_targets`, for bearings that cannot locate anything, and for several targets.
    """
    targets = read_targets(path)
    if len(targets) > 1:
        raise UserError(f"bearings: {path} has {len(targets)} targets; one")
    return targets[0].bearings


def read_targets(path: Path | str) -> list[Target]:
    """Read a file of bearings: CSV, with any of the delimiters comma, semicolon, tab, bar.

    The first line names the columns, in any order: ``time_s``; ``x_m`` and ``y_m`` (east and north), or
    ``latitude_deg`` and ``longitude_deg``; ``bearing_deg``, clockwise from north (of a grid: from its y axis), 0 to 360
    or -180 to 180, or ``bearing_rad``; ``sigma_deg`` (or ``sigma_rad``), the bearing's standard deviation, which may be
    empty where it is not known (then in all lines); of several targets ``target``, any text. Lines that begin with
    ``#`` are comments. Latitude and longitude are laid on a plane through their mean: good for some tens of kilometres.

    Raises
    ------
    UserError
        Naming line, column, value and what is allowed; of a single target also for bearings that locate nothing.
    """
    file = Path(path)
    try:
        text = read_text(file, _LARGEST_FILE, encoding="utf-8-sig")
    except Unreadable as error:
        raise UserError(f"bearings: {error}") from error
    lines = [(i, line) for i, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")]
    if not lines:
        raise UserError(f"bearings: {file} is empty; a line of column names and at least two bearings are needed")
    delimiter = max(_DELIMITERS, key=lines[0][1].count)
    header = _cells(file, *lines[0], delimiter)
    places = _GEODETIC if set(_GEODETIC) & set(header) else _LOCAL
    angles = [next((one for one in pair if one in header), pair[0]) for pair in (_BEARING, _SIGMA)]
    columns = ["time_s", *places, *angles]
    missing = [name for name in columns if name not in header]
    if missing:
        raise UserError(
            f"bearings: {file} has no column {', '.join(missing)}; time_s, x_m and y_m (or latitude_deg and "
            "longitude_deg), bearing_deg and sigma_deg are needed, of several targets also target"
        )
    names, rows = [], []
    for number, line in lines[1:]:
        row = _named(file, number, _cells(file, number, line, delimiter), header)
        names.append(row.get("target", ""))
        rows.append([_value(file, number, row, name) for name in columns])
    table = np.array(rows).reshape(-1, 5)
    for i, unit in enumerate(angles, 3):
        if unit.endswith("_rad"):
            table[:, i] = np.degrees(table[:, i])
    if np.isnan(table[:, 4]).any() and not np.isnan(table[:, 4]).all():
        raise UserError(f"bearings: {file}: {angles[1]} is empty in some lines; give it in all or in none")
    order = list(dict.fromkeys(names))
    if "" in order and len(order) > 1:
        number = lines[1 + names.index("")][0]
        raise UserError(f"bearings: {file}, line {number}: target is empty; the name of a target, as in other lines")
    if len(order) <= 1:
        return [_single(file, order[0] if order else "", table, places == _GEODETIC)]
    of = np.array(names)
    return [_target(name, table[of == name], places == _GEODETIC) for name in order]


def _single(file: Path, name: str, table: Array, geodetic: bool) -> Target:
    """Return the only target of a file, whose bearings must be able to locate it."""
    backwards = np.flatnonzero(np.diff(table[:, 0]) < 0)
    if backwards.size:
        first, second = table[backwards[0] : backwards[0] + 2, 0]
        raise UserError(f"bearings: {file}: time_s falls from {first:g} to {second:g}")
    found = _target(name, table, geodetic)
    if found.wrong:
        raise UserError(f"bearings: {file}{'' if found.wrong.startswith('has') else ':'} {found.wrong}")
    return found


def _target(name: str, table: Array, geodetic: bool) -> Target:
    """Return what the rows of a target say, in the order of time."""
    time, first, second, bearing, sigma = table[np.argsort(table[:, 0], kind="stable")].T
    origin = None
    if geodetic and len(table):
        origin = math.radians(first.mean()), math.radians(second.mean())
        north, east = _scales(origin[0])
        turned = wrap(np.radians(second) - origin[1])
        first, second = turned * east, (np.radians(first) - origin[0]) * north
    place, azimuth = np.stack([first, second], axis=-1), from_compass(bearing)
    return Target(name, Bearings(time, place, azimuth, np.radians(sigma), origin), _wrong(place, azimuth))


def _wrong(place: Array, azimuth: Array) -> str:
    """Return why bearings locate nothing; empty: they may."""
    if len(place) < 2:
        return f"has {len(place)} bearing(s); a single one locates nothing, 2 are needed"
    if np.ptp(place, axis=0).max() == 0:
        return "all positions are equal; bearings from at least two are needed"
    if np.abs(np.sin(azimuth - azimuth[0])).max() < 1e-6:
        return "all bearings are parallel; lines that cross are needed"
    return ""


def _cells(file: Path, number: int, line: str, delimiter: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]
    except csv.Error as error:  # a cell of more than 131072 characters, say
        raise UserError(f"bearings: {file}, line {number}: it cannot be read ({error})") from error


def _named(file: Path, number: int, cells: Sequence[str], header: Sequence[str]) -> dict[str, str]:
    if len(cells) != len(header):
        raise UserError(f"bearings: {file}, line {number}: {len(cells)} cells are given; {len(header)} are needed")
    return dict(zip(header, cells, strict=True))


def _value(file: Path, number: int, row: Mapping[str, str], name: str) -> float:
    least, most, allowed = _LIMITS[name]
    if name in _SIGMA and not row[name]:
        return math.nan
    try:
        value = float(row[name])
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and least <= value <= most):
        raise UserError(f"bearings: {file}, line {number}: {name} {row[name][:60]!r} is not allowed; {allowed}")
    return value
