"""Paths of what moves in a system of one's own: its state as a function of time, in the axes of the frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from diagrams.errors import UserError
from diagrams.own.flight import rocket_path
from diagrams.own.movers import (
    Fixed,
    Geodetic,
    GreatCircle,
    Kepler,
    Mover,
    PositionVelocity,
    Rocket,
    Sp3,
    Straight,
    Tle,
    Track,
    Waypoints,
)
from diagrams.own.records import Setting, sp3_path, tle_path, track_path
from systems.frames import earth_fixed_to_inertial, geodetic_state, inertial_to_earth_fixed
from systems.motion.gravity import GravityConstants
from systems.motion.great_circle import great_circle
from systems.motion.kepler import KeplerElements, mean_anomaly, state_of
from systems.motion.level_waypoints import LevelWaypointPath
from systems.motion.waypoints import WaypointPath
from systems.plants.orbit import DenseOrbit

__all__ = ["ALLOWED", "Path", "path_of"]

Array = NDArray[np.float64]
Path = Callable[[float], Array]

_KM = 1e3

_EARTH = (Geodetic, GreatCircle, Waypoints, Rocket, Kepler, PositionVelocity, Tle, Sp3, Track)

ALLOWED: dict[str, tuple[type, ...]] = {
    "local": (Fixed, Straight, Waypoints, Track),
    "earth_fixed": (*_EARTH, Straight),
    "inertial": _EARTH,
}
"""What there is in each frame."""


def path_of(mover: Mover, frame: str, setting: Setting, constants: GravityConstants, where: str) -> Path:
    """Return the state (6,) of a mover as a function of time [s], in the axes of the frame.

    Parameters
    ----------
    mover : Mover
        The scenario's field.
    frame : {'local', 'earth_fixed', 'inertial'}
    setting : Setting
        Length of a run, its date, and where files are.
    constants : GravityConstants
        J2 of 0: two bodies.
    where : str
        Name of the field, for messages.

    Raises
    ------
    UserError
        If such a thing is not in that frame, or its numbers cannot be.
    """
    if not isinstance(mover, ALLOWED[frame]):
        kinds = ", ".join(f"!{kind.__name__}" for kind in ALLOWED[frame])
        raise UserError(f"{where}: !{type(mover).__name__} is not allowed in frame {frame}; {kinds}")
    try:
        native, axes = _native(mover, frame, setting, constants, where)
    except UserError:
        raise
    except ValueError as error:
        raise UserError(f"{where}: {error}") from error
    rate = constants.earth_rate
    if axes == frame or axes == "any":
        return native
    if frame == "earth_fixed":
        return lambda t: inertial_to_earth_fixed(native(t), t, rate)
    return lambda t: earth_fixed_to_inertial(native(t), t, rate)


def _native(mover: Mover, frame: str, setting: Setting, constants: GravityConstants, where: str) -> tuple[Path, str]:
    """Return a path and the axes that it is in."""
    if isinstance(mover, Tle):
        return tle_path(mover, setting, where), "inertial"
    if isinstance(mover, Sp3):
        return sp3_path(mover, setting, constants.earth_rate, where), "inertial"
    if isinstance(mover, Track):
        return track_path(mover, setting, frame, where)
    if isinstance(mover, Rocket):
        return rocket_path(mover, setting.duration, constants, where), "earth_fixed"
    if isinstance(mover, Waypoints):
        return _way(mover, frame, where)
    if isinstance(mover, Kepler | PositionVelocity):
        return _orbit(mover, setting.duration, constants, where), "inertial"
    if isinstance(mover, Fixed):
        place = np.array([mover.east_km * _KM, mover.north_km * _KM, mover.up_m, 0.0, 0.0, 0.0])
        return lambda t: place, "local"
    if isinstance(mover, Straight):
        begin = np.concatenate(
            [
                _KM * _three(mover.position_km, f"{where}.position_km"),
                _three(mover.velocity_mps, f"{where}.velocity_mps"),
            ]
        )
        return lambda t: begin + t * np.concatenate([begin[3:], np.zeros(3)]), "any"
    course, speed = (mover.course_deg, mover.speed_mps) if isinstance(mover, GreatCircle) else (0.0, 0.0)
    angles = math.radians(mover.latitude_deg), math.radians(mover.longitude_deg)
    begin = geodetic_state(*angles, mover.height_m, math.radians(course), speed)
    if speed == 0:
        return lambda t: begin, "earth_fixed"
    circle = great_circle(begin)
    return lambda t: circle.state(t), "earth_fixed"


def _way(mover: Waypoints, frame: str, where: str) -> tuple[Path, str]:
    """Return a path by waypoints: plane ones in local axes, else on the ellipsoid."""
    field, other = ("points_km", "points_deg") if frame == "local" else ("points_deg", "points_km")
    if getattr(mover, other):
        raise UserError(f"{where}.{other}: it is not allowed in frame {frame}; {field}")
    points = [_numbers(point, 2, f"{where}.{field}.{i}") for i, point in enumerate(getattr(mover, field))]
    if len(points) < 2:
        raise UserError(f"{where}.{field}: {len(points)} are given; at least 2 are needed")
    turn = math.radians(mover.turn_rate_degps)
    if frame == "local":
        way = WaypointPath(_KM * np.array(points), mover.speed_mps, turn, mover.height_m)
        return lambda t: way.at(t), "local"
    for i, (latitude, _) in enumerate(points):
        if abs(latitude) > 90:
            raise UserError(f"{where}.points_deg.{i}: latitude {latitude:g} is not allowed; -90 to 90")
    latitude, longitude = np.radians(points).T
    level = LevelWaypointPath(latitude, longitude, mover.height_m, mover.speed_mps, turn)
    return level.at, "earth_fixed"


def _orbit(mover: Kepler | PositionVelocity, duration: float, constants: GravityConstants, where: str) -> Path:
    if isinstance(mover, Kepler):
        elements = KeplerElements(
            mover.semi_major_axis_km * _KM,
            mover.eccentricity,
            math.radians(mover.inclination_deg),
            math.radians(mover.raan_deg),
            math.radians(mover.argument_of_perigee_deg),
            mean_anomaly(math.radians(mover.true_anomaly_deg), mover.eccentricity),
        )
        state = state_of(elements, constants.mu)
    else:
        state = _KM * np.concatenate(
            [_three(mover.position_km, f"{where}.position_km"), _three(mover.velocity_kmps, f"{where}.velocity_kmps")]
        )
    orbit = DenseOrbit(state[None], duration, constants=constants, j2=constants.j2 != 0, name=where)
    return lambda t: orbit.at(t)[0]


def _three(value: Sequence[float], where: str) -> Array:
    return _numbers(value, 3, where)


def _numbers(value: Any, count: int, where: str) -> Array:
    if len(value) != count or not np.all(np.isfinite(value)):
        raise UserError(f"{where}: {list(value)} is not allowed; {count} finite numbers")
    return np.array(value, dtype=float)
