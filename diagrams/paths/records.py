"""Paths from what others have determined: two-line elements, precise orbits, recorded tracks."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path as FilePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.parts.formation import ReferenceOrbit
from quietfix.diagrams.paths.movers import Sp3, Tle, Track
from quietfix.diagrams.quantities.frame import EARTH_FIXED, Frame
from quietfix.diagrams.readers.doppler.elements import UNIX_EPOCH, checked_satellite
from quietfix.diagrams.readers.doptrack_data import teme_to_earth_fixed
from quietfix.diagrams.schema.errors import UserError, shown
from quietfix.systems.earth.frames import earth_fixed_to_inertial
from quietfix.systems.earth.geodetic import geodetic_to_ecef
from quietfix.systems.earth.time_scales import posix_of, posix_to_tai, to_tai
from quietfix.systems.files import Unreadable, read_text, regular_size
from quietfix.systems.plants.recorded import RecordedTruth, hermite
from quietfix.systems.plants.sp3 import PreciseOrbit, read_sp3
from quietfix.systems.plants.sp3_records import in_tai

__all__ = [
    "Setting",
    "file_of",
    "of_field",
    "old_elements",
    "recorded_path",
    "sp3_path",
    "stamp_of",
    "tle_path",
    "track_path",
]

Array = NDArray[np.float64]
Path = Callable[[float], Array]

_DAY = 86400.0
_NOTED, _OLDEST = 3.0, 30.0  # days between the epoch of elements and the start: SGP4 is off by 1 to 3 km per day
_PLACES = (("x_m", "y_m", "z_m"), ("latitude_deg", "longitude_deg", "height_m"))
_VELOCITY = ("vx_mps", "vy_mps", "vz_mps")
_FARTHEST = 1e10  # m, deg, m/s


@dataclass(frozen=True)
class Setting:
    """When and where records are read for.

    Attributes
    ----------
    duration : float
        Length of a run [s].
    start : str, optional
        Date and time of t = 0.
    folder : Path
        What relative paths are relative to.
    reference : ReferenceOrbit
        What !Offset is counted from.
    zero : (int, float), optional
        t = 0 as seconds of TAI since 1970, whole and rest, where no date says it.
    """

    duration: float
    start: str | None
    folder: FilePath
    reference: ReferenceOrbit = field(default_factory=ReferenceOrbit)
    zero: tuple[int, float] | None = None

    def began(self) -> tuple[int, float] | None:
        """Return t = 0 as seconds of TAI since 1970, whole and rest; None without a date."""
        if self.start is None:
            return self.zero
        try:
            return to_tai(self.start.strip(), "UTC", offsets=True)
        except ValueError as error:
            raise UserError(f"start_utc: {error}") from error


def _age(elements: Tle, setting: Setting, where: str) -> float:
    """Return how many days after their epoch the run begins; negative: before."""
    began = setting.began()
    if began is None:
        raise UserError(f"start_utc: null is not allowed with !Tle ({where}); such as 2026-03-01T12:00:00Z")
    satellite = _satellite(elements, where)
    epoch = (satellite.jdsatepoch - UNIX_EPOCH) * _DAY + satellite.jdsatepochF * _DAY
    return (posix_of(began[0]) + began[1] - epoch) / _DAY


def old_elements(elements: Tle, setting: Setting, where: str) -> str:
    """Return what a reader of the results must know of the age of elements; empty: nothing."""
    age = _age(elements, setting, where)
    if abs(age) <= _NOTED:
        return ""
    return f"{where}: epoch {abs(age):.1f} days {'before' if age > 0 else 'after'} start_utc (SGP4: km per day)."


def _satellite(elements: Tle, where: str) -> Any:
    return checked_satellite(elements.line_1, elements.line_2, (f"{where}.line_1", f"{where}.line_2"))


def _leap_seconds(second: int, age: float) -> int:
    """Return how many leap seconds there were in so many days of 86400 s before seconds of TAI since 1970."""
    civil = posix_of(second)
    before = civil - math.floor(age * _DAY)
    return (second - civil) - (posix_to_tai(before) - before)


def tle_path(elements: Tle, setting: Setting, where: str) -> Path:
    """Return a satellite's inertial state as a function of time.

    The axes of SGP4 (TEME) are turned once, by Greenwich mean sidereal time at t = 0 (UTC for UT1); from then on the
    Earth turns at its constant rate, as everywhere. Mean sidereal time runs faster by 1.2e-7 of that: 5 m in a day at
    7000 km, where SGP4 itself is off by kilometres. Its velocity is not quite the derivative of its position: off by
    0.02 m/s in a near-circular low orbit, by 1.2 m/s at an eccentricity of 0.19.

    Raises
    ------
    UserError
        For lines that cannot be, an epoch too far from the start, and elements that do not last until the end.
    """
    satellite, age, began = _satellite(elements, where), _age(elements, setting, where), setting.began()
    assert began is not None
    if abs(age) > _OLDEST:
        raise UserError(
            f"{where}.line_1: epoch {abs(age):.1f} days {'before' if age > 0 else 'after'} start_utc is not allowed; "
            f"at most {_OLDEST:g}"
        )
    day, second = divmod(posix_of(began[0]), int(_DAY))
    whole, part = UNIX_EPOCH + day, (second + began[1]) / _DAY
    # SGP4 counts days of 86400 s from the epoch of the elements, which is UTC: leap seconds since then are more
    since = part + _leap_seconds(began[0], age) / _DAY

    def at(t: float) -> Array:
        code, position, velocity = satellite.sgp4(whole, since + t / _DAY)
        if code:
            return np.full(6, np.nan)
        state = teme_to_earth_fixed(1e3 * np.array(position), 1e3 * np.array(velocity), np.array(whole + part))
        return earth_fixed_to_inertial(state, 0.0)

    for t in (0.0, setting.duration):
        code = satellite.sgp4(whole, since + t / _DAY)[0]
        if code or not np.isfinite(at(t)).all():
            raise UserError(f"{where}: SGP4 cannot tell where it is at {t:g} s (error {code})")
    return at


@lru_cache(maxsize=32)
def _orbit(path: FilePath, satellite: str, stamp: tuple[int, int]) -> PreciseOrbit:
    """Read a file once for all diagrams of a run; `stamp` tells another version of it."""
    return read_sp3(path, satellite or None)


def sp3_path(field: Sp3, setting: Setting, earth_rate: float, where: str) -> Path:
    """Return a satellite's inertial state as a function of time, from a precise orbit.

    Raises
    ------
    UserError
        If the file cannot be read, or does not cover the run.
    """
    path = file_of(field.file, setting, where)
    try:
        orbit = _orbit(path, field.satellite, stamp_of(path, where))
        start = _sp3_start(field, orbit, setting)
        if start < 0 or orbit.times[-1] < start + setting.duration:
            raise ValueError(
                f"a run from {start:g} to {start + setting.duration:g} s after the first epoch is not allowed; "
                f"{path.name} has 0 to {orbit.times[-1]:g} s"
            )
        # From the last sample before the start: the first one after it is too late.
        before = float(orbit.times[int(np.searchsorted(orbit.times, start, side="right")) - 1])
        times, states = orbit.inertial(before, earth_rate)
    except Unreadable as error:
        raise _unreadable(path, where, error) from error
    except UserError:
        raise
    except ValueError as error:
        raise UserError(f"{where}.file: {error}") from error
    # Its axes are Earth-fixed at that sample; ours are at the start.
    shift = start - before
    return _spline(times - shift, _about_z(states, earth_rate * shift), setting, f"{where}.file: {path.name}")


def _about_z(states: Array, angle: float) -> Array:
    """Return states in axes that are turned about z."""
    c, s = math.cos(angle), math.sin(angle)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return np.concatenate([states[:, :3] @ turn.T, states[:, 3:] @ turn.T], axis=1)


def _sp3_start(field: Sp3, orbit: PreciseOrbit, setting: Setting) -> float:
    began = setting.began()
    if field.start_s is not None:
        return field.start_s
    if began is None:
        return 0.0
    whole, rest = in_tai(orbit.first_epoch, orbit.time_system)
    return began[0] - whole + (began[1] - rest)


def stamp_of(path: FilePath, where: str) -> tuple[int, int]:
    """Return time and size of a regular file: they tell another version of it.

    Raises
    ------
    UserError
        If there is none.
    """
    try:
        size = regular_size(path)
    except Unreadable as error:
        raise _unreadable(path, where, error) from error
    return path.stat().st_mtime_ns, size


@contextmanager
def of_field(where: str) -> Iterator[None]:
    """Name the field whose file a reader refuses."""
    try:
        yield
    except UserError as error:
        message = str(error)
        raise (error if message.startswith(where) else UserError(f"{where}.file: {message}")) from error.__cause__


def _unreadable(path: FilePath, where: str, error: Unreadable) -> UserError:
    return UserError(f"{where}.file: {shown(path)} cannot be read ({error.reason})")


def file_of(name: str, setting: Setting, where: str) -> FilePath:
    """Return the path of a file that a field names.

    Raises
    ------
    UserError
        If it names none.
    """
    if not name:
        raise UserError(f"{where}.file: none is given; the path of a file")
    return setting.folder / name


def _spline(times: Array, states: Array, setting: Setting, what: str) -> Path:
    """Return a Hermite spline that has no gap during a run."""
    first = max(int(np.searchsorted(times, 0.0, side="right")) - 1, 0)
    last = int(np.searchsorted(times, setting.duration, side="left"))
    for i in first + np.flatnonzero(~np.isfinite(states[first : last + 1]).all(axis=-1)):
        raise UserError(f"{what} has a gap at {times[i]:g} s of a run of {setting.duration:g} s")
    return lambda t: hermite(times, states, t)[0]


def track_path(field: Track, setting: Setting, frame: Frame, where: str) -> tuple[Path, Frame | None]:
    """Return a recorded track as a function of time, and the axes that it is in; None: those of the system.

    Raises
    ------
    UserError
        If the file cannot be read, says something else than a track, or does not cover the run.
    """
    path = file_of(field.file, setting, where)
    where = f"{where}.file: {path.name}"
    names, table, clock = _table(path, where)
    geodetic = "latitude_deg" in names
    if geodetic and frame.flat:
        raise UserError(f"{where}: latitude_deg is not allowed in frame {frame.name}; x_m, y_m, z_m")
    times = _times(clock, names, table, setting, where)
    columns = {name: table[:, i] for i, name in enumerate(names)}
    if geodetic:
        if np.any(np.abs(columns["latitude_deg"]) > 90):
            raise UserError(f"{where}: a latitude beyond 90 degrees is not allowed")
        angles = np.radians(columns["latitude_deg"]), np.radians(columns["longitude_deg"])
        states = geodetic_to_ecef(*angles, columns["height_m"])
    else:
        told = (*_PLACES[0], *_VELOCITY) if _VELOCITY[0] in names else _PLACES[0]
        states = np.stack([columns[name] for name in told], axis=1)
    return recorded_path(times, states, setting, where), EARTH_FIXED if geodetic else None


def recorded_path(times: Array, states: Array, setting: Setting, what: str) -> Path:
    """Return a spline through recorded samples as a function of time.

    Parameters
    ----------
    times : ndarray, shape (samples,)
        Since t = 0 [s].
    states : ndarray, shape (samples, 3) or (samples, 6)
        See `RecordedTruth`; a NaN is a gap.
    setting : Setting
        Of the run, which they must cover.
    what : str
        Field and file, for messages.

    Raises
    ------
    UserError
        For times that do not increase, a record that does not cover the run, and a gap in it.
    """
    try:
        truth = RecordedTruth(times, states, name="track")
    except ValueError as error:
        raise UserError(f"{what}: {error}") from error
    if times[0] > 0 or times[-1] < setting.duration:
        raise UserError(
            f"{what}: a run from 0 to {setting.duration:g} s is not allowed; it has {times[0]:g} to {times[-1]:g} s"
        )
    return _spline(truth.times, truth.states[:, 0], setting, what)


def _times(clock: list[str] | None, names: list[str], table: Array, setting: Setting, where: str) -> Array:
    """Return seconds since t = 0."""
    if clock is None:
        return table[:, names.index("time_s")]
    try:
        stamps = [to_tai(one.strip(), "UTC", offsets=True) for one in clock]
    except ValueError as error:
        raise UserError(f"{where}: time {error}") from error
    zero = setting.began() or stamps[0]
    return np.array([whole - zero[0] + (rest - zero[1]) for whole, rest in stamps])


def _table(path: FilePath, where: str) -> tuple[list[str], Array, list[str] | None]:
    """Return names and values of the columns of numbers, and the column of dates where there is one."""
    try:
        lines = [line for line in csv.reader(read_text(path).lstrip("\ufeff").splitlines(), strict=True) if line]
    except Unreadable as error:
        raise UserError(f"{where.partition(':')[0]}: {shown(path)} cannot be read ({error.reason})") from error
    except csv.Error as error:
        raise UserError(f"{where} cannot be read ({error})") from error
    names = [name.strip() for name in lines[0]] if lines else []
    kinds = [
        {time, *place, *more}
        for time in ("time_s", "time")
        for place, more in ((_PLACES[0], ()), (_PLACES[0], _VELOCITY), (_PLACES[1], ()))
    ]
    if set(names) not in kinds or len(set(names)) < len(names):
        raise UserError(
            f"{where}: columns {str(names)[:200]} are not allowed; time_s or time, with x_m, y_m, z_m (and vx_mps, "
            "vy_mps, vz_mps) or latitude_deg, longitude_deg, height_m"
        )
    dates = names.index("time") if "time" in names else None
    rows, clock = [], []
    for i, line in enumerate(lines[1:], 2):
        cells = list(line)
        try:
            if len(cells) != len(names):
                raise ValueError
            if dates is not None:
                clock.append(cells.pop(dates))
            rows.append([float(cell) for cell in cells])
            if not all(abs(value) <= _FARTHEST for value in rows[-1]):
                raise ValueError
        except ValueError as error:
            raise UserError(f"{where}: row {i} {str(line)[:200]} is not allowed; {len(names)} finite values") from error
    left = [name for name in names if name != "time"]
    return left, np.array(rows).reshape(-1, len(left)), clock if dates is not None else None
