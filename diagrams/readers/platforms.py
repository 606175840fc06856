"""Tables of platforms: where each stands, or where it was when."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.rows import Chunk, broken, chunks_of
from quietfix.diagrams.readers.stamps import BadStamp, read_stamps

__all__ = ["PlatformRows", "PlatformTable", "read_platforms"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_GEODETIC, _CARTESIAN = ("latitude_deg", "longitude_deg", "height_m"), ("x_m", "y_m", "z_m")
_PLAIN = ("x", "y", "z")
_VELOCITY = ("vx_mps", "vy_mps", "vz_mps")
_WORDS = (
    "name, and latitude_deg, longitude_deg, height_m, or x_m, y_m, z_m; of one that moves also time (with its zone) or "
    "time_s, and if known vx_mps, vy_mps, vz_mps"
)
_LIMITS = {"latitude_deg": 90.0, "longitude_deg": 360.0}
_FARTHEST = 1e10  # m, m/s, s
_MOST = 10_000  # platforms


@dataclass(frozen=True, eq=False)
class PlatformRows:
    """What a table says of one platform.

    Attributes
    ----------
    name : str
    line : int
        The first of its rows.
    geodetic : bool
        Whether places are latitude and longitude [deg] and height above the ellipsoid [m]; else x, y, z [m] in the axes
        of the frame.
    places : ndarray, shape (k, 3)
        One, if it stands.
    velocities : ndarray, shape (k, 3), optional
        [m/s]
    second : ndarray of int, shape (k,), optional
        Strictly increasing: whole seconds of TAI since 1970 (`quietfix.systems.earth.time_scales`); None: it has no
        dates.
    rest : ndarray, shape (k,), optional
        And the rest [s]; without `second` seconds since t = 0. None: it stands.
    """

    name: str
    line: int
    geodetic: bool
    places: Array
    velocities: Array | None = None
    second: Integers | None = None
    rest: Array | None = None


@dataclass(frozen=True, eq=False)
class PlatformTable:
    """A table.

    Attributes
    ----------
    platforms : dict of str to PlatformRows
        By name, in its order.
    notes : tuple of str
        What is doubtful.
    """

    platforms: Mapping[str, PlatformRows]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class _Columns:
    """Names of the columns that count."""

    place: tuple[str, str, str]
    velocity: bool
    time: str


def read_platforms(path: Path | str) -> PlatformTable:
    """Read a table of platforms, as text with any delimiter or as Parquet.

    A platform with one row and without a time stands; one with several rows moves, and they need times. Rows may be in
    any order; a row that is there twice is one.

    Raises
    ------
    UserError
        In one line with file, line, column, value and what is allowed.
    """
    file = Path(path)
    names: list[str] = []
    notes: dict[str, None] = {}
    lines: list[NDArray[np.int64]] = []
    numbers: list[Array] = []
    seconds: list[Integers] = []
    columns: _Columns | None = None
    for chunk in chunks_of(file, _known, _WORDS):
        columns = columns or _columns(file, list(chunk.columns))
        found, values, whole = _chunk(file, chunk, columns)
        names += found
        notes |= dict.fromkeys(chunk.notes)
        lines.append(np.asarray(chunk.lines, dtype=np.int64))
        numbers.append(values)
        seconds.append(whole)
    if not names or columns is None:
        raise broken(file, None, "it has no rows; at least one platform")
    rows: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        rows.setdefault(name, []).append(i)
    if len(rows) > _MOST:
        raise broken(file, None, f"{len(rows)} platforms are not allowed; at most {_MOST}")
    table = np.concatenate(lines), np.concatenate(numbers), np.concatenate(seconds)
    platforms = {name: _platform(file, name, np.array(which), columns, *table) for name, which in rows.items()}
    return PlatformTable(platforms, tuple(notes))


def _known(names: Sequence[str]) -> bool:
    return "name" in names and any(set(place) <= set(names) for place in (_GEODETIC, _CARTESIAN, _PLAIN))


def _columns(file: Path, names: Sequence[str]) -> _Columns:
    places = [place for place in (_GEODETIC, _CARTESIAN, _PLAIN) if set(place) <= set(names)]
    times = [name for name in ("time", "time_s") if name in names]
    velocity = [name for name in _VELOCITY if name in names]
    if len(places) > 1 or len(times) > 1:
        raise broken(file, None, f"columns {', '.join(names)[:200]} are not allowed; one of each: {_WORDS}")
    if velocity and (len(velocity) < 3 or places[0] == _GEODETIC or not times):
        raise broken(
            file, None, f"columns {', '.join(velocity)} are not allowed; {', '.join(_VELOCITY)} with x_m and time"
        )
    others = [name for name in names if name not in ("name", *places[0], *times, *velocity)]
    if others:
        raise broken(file, None, f"column {others[0][:60]} is not known; {_WORDS}")
    return _Columns(places[0], bool(velocity), times[0] if times else "")


def _chunk(file: Path, chunk: Chunk, columns: _Columns) -> tuple[list[str], Array, Integers]:
    """Return names, numbers (k, 7: place, velocity, rest or seconds) and whole seconds of some rows."""
    names = _texts(chunk.columns["name"])
    for line, name in zip(chunk.lines, names, strict=True):
        if not name:
            raise broken(file, line, "name: nothing is not allowed; the name of a platform")
    wanted = (*columns.place, *(_VELOCITY if columns.velocity else ()))
    values = np.full((len(names), 7), np.nan)
    for i, name in enumerate(wanted):
        values[:, i] = _floats(file, chunk, name)
    whole = np.zeros(len(names), dtype=np.int64)
    if columns.time == "time_s":
        values[:, 6] = _floats(file, chunk, "time_s", empty=True)
    elif columns.time:
        texts = _texts(chunk.columns["time"])
        dated = [i for i, text in enumerate(texts) if text]
        try:
            whole[dated], values[dated, 6] = read_stamps([texts[i] for i in dated])
        except BadStamp as error:
            raise broken(file, chunk.lines[dated[error.at]], f"time: {error}") from error
    return names, values, whole


def _texts(column: Any) -> list[str]:
    """Return texts; of a column of numbers these, without a decimal point."""
    if isinstance(column, list):
        return column
    return ["" if np.isnan(one) else f"{one:.0f}" if one == int(one) else repr(float(one)) for one in column]


def _floats(file: Path, chunk: Chunk, name: str, empty: bool = False) -> Array:
    """Return a column of finite numbers; where it may be empty NaN for nothing."""
    column = chunk.columns[name]
    found = np.empty(len(chunk.lines))
    most = _LIMITS.get(name, _FARTHEST)
    for i, value in enumerate(column):
        found[i] = np.nan if empty and value == "" else _number(value)
        if not (abs(found[i]) <= most or (empty and np.isnan(found[i]))):
            shown = repr(value if isinstance(value, str) else float(value))
            message = f"{name}: {shown:.60} is not allowed; a number, at most {most:g} in size"
            raise broken(file, chunk.lines[i], message)
    return found


def _number(value: str | float) -> float:
    try:
        return np.inf if isinstance(value, str) and "_" in value else float(value)
    except ValueError:
        return np.inf


def _platform(
    file: Path, name: str, which: NDArray[np.intp], columns: _Columns, lines: Integers, values: Array, whole: Integers
) -> PlatformRows:
    """Return the rows of one platform in the order of time."""
    geodetic = columns.place == _GEODETIC
    line = int(lines[which[0]])
    timed = np.isfinite(values[which, 6])
    if which.size == 1 and not timed[0]:
        return PlatformRows(name, line, geodetic, values[which, :3])
    if not columns.time or not timed.all():
        missing = int(lines[which[int(np.argmin(timed))]]) if columns.time else int(lines[which[1]])
        raise broken(file, missing, f"{name[:60]!r} without a time is not allowed in {which.size} rows; time or time_s")
    order = which[np.lexsort((values[which, 6], whole[which]))]
    same = np.concatenate([[False], (np.diff(whole[order]) == 0) & (np.diff(values[order, 6]) == 0)])
    for i in np.flatnonzero(same):
        if not np.array_equal(values[order[i]], values[order[i - 1]], equal_nan=True):
            lines_ = sorted((int(lines[order[i]]), int(lines[order[i - 1]])))
            raise broken(
                file, lines_[1], f"{name[:60]!r} is somewhere else at the same time in line {lines_[0]}; one of them"
            )
    order = order[~same]
    velocity = values[order, 3:6] if columns.velocity else None
    moments = whole[order] if columns.time == "time" else None
    return PlatformRows(name, line, geodetic, values[order, :3], velocity, moments, values[order, 6])
