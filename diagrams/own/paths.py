"""Paths of what moves in a system of one's own: its state as a function of time, in the axes of the frame."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from diagrams.errors import UserError
from diagrams.own.movers import Fixed, Geodetic, GreatCircle, Kepler, Mover, PositionVelocity, Straight, Waypoints
from systems.frames import earth_fixed_to_inertial, geodetic_state, inertial_to_earth_fixed
from systems.motion.gravity import GravityConstants
from systems.motion.great_circle import great_circle
from systems.motion.kepler import KeplerElements, state_of
from systems.motion.waypoints import WaypointPath
from systems.plants.orbit import DenseOrbit

__all__ = ["ALLOWED", "Path", "path_of"]

Array = NDArray[np.float64]
Path = Callable[[float], Array]

_KM = 1e3

ALLOWED: dict[str, tuple[type, ...]] = {
    "local": (Fixed, Straight, Waypoints),
    "earth_fixed": (Geodetic, GreatCircle, Straight, Kepler, PositionVelocity),
    "inertial": (Kepler, PositionVelocity, Geodetic, GreatCircle),
}
"""What there is in each frame."""


def path_of(mover: Mover, frame: str, duration: float, constants: GravityConstants, where: str) -> Path:
    """Return the state (6,) of a mover as a function of time [s], in the axes of the frame.

    Parameters
    ----------
    mover : Mover
        The scenario's field.
    frame : {'local', 'earth_fixed', 'inertial'}
    duration : float
        Orbits are solved until then [s].
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
        native, axes = _native(mover, duration, constants, where)
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


def _native(mover: Mover, duration: float, constants: GravityConstants, where: str) -> tuple[Path, str]:
    """Return a path and the axes that it is in."""
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
    if isinstance(mover, Waypoints):
        points = [_KM * _numbers(p, 2, f"{where}.points_km.{i}") for i, p in enumerate(mover.points_km)]
        if len(points) < 2:
            raise UserError(f"{where}.points_km: {len(points)} are given; at least 2 are needed")
        way = WaypointPath(np.array(points), mover.speed_mps, math.radians(mover.turn_rate_degps), mover.height_m)
        return lambda t: way.at(t), "local"
    if isinstance(mover, Geodetic | GreatCircle):
        course, speed = (mover.course_deg, mover.speed_mps) if isinstance(mover, GreatCircle) else (0.0, 0.0)
        angles = math.radians(mover.latitude_deg), math.radians(mover.longitude_deg)
        begin = geodetic_state(*angles, mover.height_m, math.radians(course), speed)
        if speed == 0:
            return lambda t: begin, "earth_fixed"
        circle = great_circle(begin)
        return lambda t: circle.state(t), "earth_fixed"
    if isinstance(mover, Kepler):
        angles_deg = mover.inclination_deg, mover.raan_deg, mover.argument_of_perigee_deg, mover.true_anomaly_deg
        elements = KeplerElements(
            mover.semi_major_axis_km * _KM, mover.eccentricity, *(math.radians(angle) for angle in angles_deg)
        )
        state = state_of(elements, constants.mu)
    else:
        assert isinstance(mover, PositionVelocity)
        state = _KM * np.concatenate(
            [_three(mover.position_km, f"{where}.position_km"), _three(mover.velocity_kmps, f"{where}.velocity_kmps")]
        )
    orbit = DenseOrbit(state[None], duration, constants=constants, j2=constants.j2 != 0, name=where)
    return lambda t: orbit.at(t)[0], "inertial"


def _three(value: Sequence[float], where: str) -> Array:
    return _numbers(value, 3, where)


def _numbers(value: Any, count: int, where: str) -> Array:
    if len(value) != count or not np.all(np.isfinite(value)):
        raise UserError(f"{where}: {list(value)} is not allowed; {count} finite numbers")
    return np.array(value, dtype=float)
