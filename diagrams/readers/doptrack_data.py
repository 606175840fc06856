"""Reading the DopTrack recordings: passes of the satellite Delfi-C3 over one station."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.schema.yaml_text import load_yaml
from quietfix.systems.constants import EARTH_RATE, SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import geodetic_to_ecef
from quietfix.systems.earth.time_scales import to_posix
from quietfix.systems.files import read_text

__all__ = ["NOMINAL", "Pass", "read_passes", "satellite_states", "teme_to_earth_fixed"]

Array = NDArray[np.float64]

NOMINAL = 145.868e6
"""Carrier that frequencies are turned into range rates with [Hz]; its error is part of every pass's bias."""

_J2000 = 2451545.0
_UNIX = 2440587.5  # Julian date of 1970, the zero of `to_posix`
_DAY = 86400.0
_HIGHEST = 1e5  # m
_LARGEST = 1e12  # Hz, s


@dataclass(frozen=True, eq=False)
class Pass:
    r"""One pass.

    Attributes
    ----------
    name : str
        What its file is named after: date and time of day.
    start : float
        Julian date of the epoch, UTC.
    times : ndarray, shape (samples,)
        Seconds after the epoch.
    range_rate : ndarray, shape (samples,)
        :math:`c\,(1 - f/f_0)` with the nominal carrier [m/s]: range rate plus the oscillator's error.
    satellite : ndarray, shape (samples, 6)
        Earth-fixed state of the satellite [m, m/s] by SGP4 from the pass's own elements.
    predicted_elevation : float
        Largest elevation that was predicted before the pass [deg].
    station : ndarray, shape (3,)
        Earth-fixed position of the station [m]; for scoring only.
    altitude : float
        Its height above the ellipsoid [m].
    """

    name: str
    start: float
    times: Array
    range_rate: Array
    satellite: Array
    predicted_elevation: float
    station: Array
    altitude: float


def teme_to_earth_fixed(position: Array, velocity: Array, julian: Array) -> Array:
    """Return Earth-fixed states (..., 6) of TEME positions [m] and velocities [m/s], (..., 3).

    Turned by Greenwich mean sidereal time (IAU 1982, the one that belongs to TEME); UTC stands for UT1 (up to 0.9 s,
    here 0.2 s: 100 m at the satellite) and the pole is at the pole (15 m).
    """
    century = (julian - _J2000) / 36525.0
    seconds = 67310.54841 + (876600 * 3600 + 8640184.812866) * century + 0.093104 * century**2 - 6.2e-6 * century**3
    angle = 2 * np.pi * (np.mod(seconds, _DAY) / _DAY)
    c, s = np.cos(angle), np.sin(angle)
    x = c * position[..., 0] + s * position[..., 1]
    y = c * position[..., 1] - s * position[..., 0]
    vx = c * velocity[..., 0] + s * velocity[..., 1] + EARTH_RATE * y
    vy = c * velocity[..., 1] - s * velocity[..., 0] - EARTH_RATE * x
    return np.stack([x, y, position[..., 2], vx, vy, velocity[..., 2]], axis=-1)


def satellite_states(line1: str, line2: str, julian: float, seconds: Array) -> Array:
    """Return Earth-fixed states (samples, 6) by SGP4 from two-line elements.

    Raises
    ------
    UserError
        If the package sgp4 is not installed, or the elements cannot be propagated.
    """
    try:
        from sgp4.api import Satrec
    except ImportError as error:
        raise UserError("replay doptrack: the package sgp4 is needed; pip install sgp4") from error
    try:
        satellite = Satrec.twoline2rv(line1, line2)
    except ValueError as error:
        raise UserError(f"two-line elements: {line1[:24]!r} is not allowed ({error})") from error
    fraction = seconds / _DAY
    code, position, velocity = satellite.sgp4_array(np.full(seconds.size, julian), fraction)
    if np.any(code):
        raise UserError(f"two-line elements: SGP4 error {int(code.max())} for {line1[:24]!r}")
    return teme_to_earth_fixed(1e3 * position, 1e3 * velocity, julian + fraction)


def read_passes(folder: Path) -> list[Pass]:
    """Return all passes in the order of time.

    An epoch may have any offset from UTC; one without an offset is UTC.

    Raises
    ------
    UserError
        If there is none, a file cannot be read or is alone, or the passes are not of one station.
    """
    files = sorted(folder.glob("Delfi-C3_*.yml"))
    if not files:
        raise UserError(f"data: {folder} holds no passes (Delfi-C3_*.yml)")
    for table in sorted(folder.glob("Delfi-C3_*.csv")):
        if not table.with_suffix(".yml").is_file():
            raise UserError(f"data: {table} has no file beside it that ends in .yml, which says when it begins")
    passes = sorted((_read(file) for file in files), key=lambda one: one.start)
    for one in passes[1:]:
        if np.any(one.station != passes[0].station):
            raise UserError(f"data: pass {one.name} is of another station than pass {passes[0].name}; one is located")
    return passes


def _read(file: Path) -> Pass:
    try:
        about: Any = load_yaml(read_text(file))
        table = np.loadtxt(io.StringIO(read_text(file.with_suffix(".csv"))), delimiter=",", comments="#", ndmin=2)
        whole, rest = to_posix(str(about["tracking"]["epoch"]))
        place = about["station"]["position"]
        elements = about["satellite"]["tle"]
        elevation = float(about["prediction"]["max_elevation"])
        altitude = float(place["altitude"])
        station = geodetic_to_ecef(
            np.radians(float(place["latitude"])), np.radians(float(place["longitude"])), altitude
        )
        lines = str(elements["line1"]), str(elements["line2"])
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise UserError(f"data: {file} cannot be read ({' '.join(str(error).split())})") from error
    if not np.isfinite([elevation, *station]).all() or abs(altitude) > _HIGHEST:
        raise UserError(f"data: {file}: place of the station or max_elevation is not allowed; finite numbers")
    if not np.all(np.abs(table) <= _LARGEST):
        raise UserError(f"data: {file.with_suffix('.csv')}: numbers of at most {_LARGEST:g} in size are needed")
    if table.shape[1] < 2 or table.shape[0] < 2 or np.any(np.diff(table[:, 0]) <= 0):
        raise UserError(f"data: {file.with_suffix('.csv')} is not a pass; increasing times and frequencies are needed")
    start = _UNIX + (whole + rest) / _DAY
    times = table[:, 0]
    return Pass(
        name=file.stem.rsplit("_", 1)[1],
        start=start,
        times=times,
        range_rate=SPEED_OF_LIGHT * (1 - table[:, 1] / NOMINAL),
        satellite=satellite_states(*lines, start, times),
        predicted_elevation=elevation,
        station=station,
        altitude=altitude,
    )
