"""Paths of what moves in a system of one's own: its state as a function of time, in the axes of the frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.parts.formation import initial_state
from quietfix.diagrams.paths.ephemerides import oem_path
from quietfix.diagrams.paths.flight import rocket_path
from quietfix.diagrams.paths.movers import (
    Fixed,
    Geodetic,
    Gpx,
    GreatCircle,
    Kepler,
    Mover,
    Oem,
    Offset,
    Platform,
    PositionVelocity,
    Rocket,
    Sp3,
    Straight,
    StraightLine,
    Tle,
    Track,
    Waypoints,
)
from quietfix.diagrams.paths.receivers import gpx_path
from quietfix.diagrams.paths.records import Setting, sp3_path, tle_path, track_path
from quietfix.diagrams.paths.tables import platform_path
from quietfix.diagrams.quantities.frame import EARTH_FIXED, INERTIAL, LOCAL, Frame, as_frame
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.frames import earth_fixed_to_inertial, inertial_to_earth_fixed
from quietfix.systems.earth.geodetic import geodetic_state
from quietfix.systems.plants.orbit import DenseOrbit
from quietfix.systems.trajectories.gravity import GravityConstants
from quietfix.systems.trajectories.great_circle import great_circle, straight_line
from quietfix.systems.trajectories.level_waypoints import LevelWaypointPath
from quietfix.systems.trajectories.waypoints import WaypointPath

__all__ = ["ALLOWED", "Path", "path_of", "paths_of"]

Array = NDArray[np.float64]
Path = Callable[[float], Array]

_KM = 1e3
_INSIDE = 6.3e6  # m from the Earth's centre, 57 km below the poles

_ON_EARTH = (Geodetic, StraightLine, GreatCircle, Waypoints, Rocket, Kepler, PositionVelocity, Offset, Tle, Sp3)
_EARTH = (*_ON_EARTH, Oem, Gpx, Platform, Track)

ALLOWED: dict[str, tuple[type, ...]] = {
    "local": (Fixed, Straight, Waypoints, Platform, Track),
    "earth_fixed": (*_EARTH, Straight),
    "inertial": _EARTH,
}
"""What there is in each frame."""


def path_of(mover: Mover, frame: Frame | str, setting: Setting, constants: GravityConstants, where: str) -> Path:
    """Return the state (6,) of a mover as a function of time [s], in the axes of the frame.

    Parameters
    ----------
    mover : Mover
        The scenario's field.
    frame : Frame, or its name
    setting : Setting
        Length of a run, its date, where files are, and what offsets are counted from.
    constants : GravityConstants
        J2 of 0: two bodies.
    where : str
        Name of the field, for messages.

    Raises
    ------
    UserError
        If such a thing is not in that frame, or its numbers cannot be.
    """
    return paths_of({where: mover}, frame, setting, constants)[0]


def paths_of(
    movers: Mapping[str, Mover], frame: Frame | str, setting: Setting, constants: GravityConstants
) -> list[Path]:
    """Return the paths of movers by the names of their fields; see `path_of`.

    Satellites by elements, states and offsets are integrated together, so that all of them have the steps of the one
    that needs the shortest.

    Raises
    ------
    UserError
        As `path_of`.
    """
    frame = as_frame(frame)
    allowed = ALLOWED[frame.name]
    for where, mover in movers.items():
        if not isinstance(mover, allowed):
            kinds = ", ".join(f"!{kind.__name__}" for kind in allowed)
            raise UserError(f"{where}: !{type(mover).__name__} is not allowed in frame {frame.name}; {kinds}")
    found = {}
    orbits = {where: mover for where, mover in movers.items() if isinstance(mover, Kepler | PositionVelocity | Offset)}
    if orbits:
        found = _orbits(orbits, setting, constants)
    for where, mover in movers.items():
        if where not in found:
            with _named(where):
                found[where] = _native(mover, frame, setting, constants, where)
    return [_turned(*found[where], frame, constants.earth_rate) for where in movers]


@contextmanager
def _named(where: str) -> Iterator[None]:
    """Name the field that a block refuses."""
    try:
        yield
    except UserError:
        raise
    except ValueError as error:
        raise UserError(f"{where}: {error}") from error


def _turned(native: Path, axes: Frame | None, frame: Frame, rate: float) -> Path:
    if axes is frame or axes is None:
        return native
    if frame.geodetic:
        return lambda t: inertial_to_earth_fixed(native(t), t, rate)
    return lambda t: earth_fixed_to_inertial(native(t), t, rate)


def _orbits(
    movers: Mapping[str, Kepler | PositionVelocity | Offset], setting: Setting, constants: GravityConstants
) -> dict[str, tuple[Path, Frame | None]]:
    """Return the inertial paths of satellites, of one solution for all of them."""
    states = {where: initial_state(one, setting.reference, constants, where) for where, one in movers.items()}

    def solved(*names: str) -> DenseOrbit:
        begin = np.array([states[where] for where in names])
        return DenseOrbit(begin, setting.duration, constants=constants, j2=constants.j2 != 0, name=names[0])

    try:
        orbit = solved(*movers)
    except ValueError:
        for where in movers:  # the one that cannot be says so by its own name
            with _named(where):
                solved(where)
        raise
    last: dict[float, Array] = {}

    def at(i: int, t: float) -> Array:
        if t not in last:  # all of them are asked for the same time, one after the other
            last.clear()
            last[t] = orbit.at(t)
        return last[t][i]

    return {where: (partial(at, i), INERTIAL) for i, where in enumerate(movers)}


def _native(
    mover: Mover, frame: Frame, setting: Setting, constants: GravityConstants, where: str
) -> tuple[Path, Frame | None]:
    """Return a path and the axes that it is in; None: those of the system, whatever they are."""
    if isinstance(mover, Tle):
        return tle_path(mover, setting, where), INERTIAL
    if isinstance(mover, Sp3):
        return sp3_path(mover, setting, constants.earth_rate, where), INERTIAL
    if isinstance(mover, Oem):
        return oem_path(mover, setting, constants.earth_rate, where), INERTIAL
    if isinstance(mover, Gpx):
        return gpx_path(mover, setting, where), EARTH_FIXED
    if isinstance(mover, Platform):
        return platform_path(mover, setting, frame, where)
    if isinstance(mover, Track):
        return track_path(mover, setting, frame, where)
    if isinstance(mover, Rocket):
        return rocket_path(mover, setting.duration, constants, where), EARTH_FIXED
    if isinstance(mover, Waypoints):
        return _way(mover, frame, where)
    if isinstance(mover, Fixed):
        place = np.array([mover.east_km * _KM, mover.north_km * _KM, mover.up_m, 0.0, 0.0, 0.0])
        return lambda t: place, LOCAL
    if isinstance(mover, Straight):
        begin = np.concatenate(
            [
                _KM * _three(mover.position_km, f"{where}.position_km"),
                _three(mover.velocity_mps, f"{where}.velocity_mps"),
            ]
        )
        if not frame.flat and np.linalg.norm(begin[:3]) < _INSIDE:
            raise UserError(f"{where}.position_km: {list(mover.position_km)} is not allowed; it is inside the Earth")
        return lambda t: straight_line(begin, t), None
    assert isinstance(mover, Geodetic | GreatCircle | StraightLine)
    course, speed = (0.0, 0.0) if isinstance(mover, Geodetic) else (mover.course_deg, mover.speed_mps)
    angles = math.radians(mover.latitude_deg), math.radians(mover.longitude_deg)
    begin = geodetic_state(*angles, mover.height_m, math.radians(course), speed)
    if speed == 0:
        return lambda t: begin, EARTH_FIXED
    if isinstance(mover, StraightLine):
        return lambda t: straight_line(begin, t), EARTH_FIXED
    circle = great_circle(begin)
    return lambda t: circle.state(t), EARTH_FIXED


def _way(mover: Waypoints, frame: Frame, where: str) -> tuple[Path, Frame]:
    """Return a path by waypoints: plane ones in local axes, else on the ellipsoid."""
    field, other = ("points_km", "points_deg") if frame.flat else ("points_deg", "points_km")
    if getattr(mover, other):
        raise UserError(f"{where}.{other}: it is not allowed in frame {frame.name}; {field}")
    points = [_numbers(point, 2, f"{where}.{field}.{i}") for i, point in enumerate(getattr(mover, field))]
    if len(points) < 2:
        raise UserError(f"{where}.{field}: {len(points)} are given; at least 2 are needed")
    turn = math.radians(mover.turn_rate_degps)
    if frame.flat:
        way = WaypointPath(_KM * np.array(points), mover.speed_mps, turn, mover.height_m)
        return lambda t: way.at(t), LOCAL
    for i, (latitude, _) in enumerate(points):
        if abs(latitude) > 90:
            raise UserError(f"{where}.points_deg.{i}: latitude {latitude:g} is not allowed; -90 to 90")
    latitude, longitude = np.radians(points).T
    level = LevelWaypointPath(latitude, longitude, mover.height_m, mover.speed_mps, turn)
    return level.at, EARTH_FIXED


def _three(value: Sequence[float], where: str) -> Array:
    return _numbers(value, 3, where)


def _numbers(value: Any, count: int, where: str) -> Array:
    if len(value) != count or not np.all(np.isfinite(value)):
        raise UserError(f"{where}: {list(value)} is not allowed; {count} finite numbers")
    return np.array(value, dtype=float)
