"""A path of constant height above the ellipsoid through waypoints, with turns of constant rate."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.systems.earth.geodetic import enu_rotation
from quietfix.systems.trajectories.great_circle import level_state
from quietfix.systems.trajectories.waypoints import REVERSAL

__all__ = ["LevelWaypointPath"]

Array = NDArray[np.float64]


class LevelWaypointPath:
    r"""Great circles joined by turns that begin before a waypoint and end behind it ("fly-by").

    All of it is a path of the *normal of the ellipsoid* on the unit sphere, at the constant rate w: great circles, as
    `great_circle` has them, and between them small circles that touch both. A small circle of angular radius r turns
    the course at w cot r relative to a great circle, hence tan r = w / (turn rate). It touches the legs at the angle d
    before and behind the waypoint, sin d = tan r tan(turn / 2): Napier's rule in the triangle of waypoint, point of
    contact and centre. Height is exactly constant; the speed is the given one at the first waypoint and follows the
    radius of curvature of the ellipsoid afterwards, within 1 % over the whole Earth, and the radius of a turn with it.

    The path starts at the first waypoint; behind the last one it goes on along the last great circle.

    Parameters
    ----------
    latitude, longitude : array_like, shape (waypoints,)
        Geodetic [rad], at least two.
    height : float
        Above the ellipsoid [m].
    speed : float
        > 0 [m/s].
    turn_rate : float
        > 0 [rad/s].

    Raises
    ------
    ValueError
        For equal or opposite neighbours, a reversal of the course, and turns that do not fit into their legs.
    """

    def __init__(
        self, latitude: ArrayLike, longitude: ArrayLike, height: float, speed: float, turn_rate: float
    ) -> None:
        lat, lon = np.asarray(latitude, dtype=float), np.asarray(longitude, dtype=float)
        if lat.ndim != 1 or lat.shape != lon.shape or lat.size < 2:
            raise ValueError(f"waypoints: shapes {lat.shape} and {lon.shape} are not allowed; at least two of each")
        for name, value, unit in (("speed", speed, "m/s"), ("turn_rate", turn_rate, "rad/s")):
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name}: {value} is not allowed; it must be > 0 {unit}")
        normals = enu_rotation(lat, lon)[:, 2]
        crosses = np.cross(normals[:-1], normals[1:])
        sines = np.linalg.norm(crosses, axis=-1)
        for i in np.flatnonzero(sines < 1e-9):
            raise ValueError(f"waypoints: {i} and {i + 1} are equal or opposite each other")
        axes = crosses / sines[:, None]
        lengths = np.arctan2(sines, np.einsum("ki,ki->k", normals[:-1], normals[1:]))
        self.height = float(height)
        per_rate = level_state(normals[0], np.cross(axes[0], normals[0]), np.array(self.height))[3:]
        self.rate = speed / float(np.linalg.norm(per_rate))
        self._segments = _segments(normals, axes, lengths, self.rate, turn_rate)

    def at(self, time: float) -> Array:
        """Return Earth-fixed position [m] and velocity [m/s], shape (6,), at `time` [s] >= 0."""
        i = int(np.searchsorted(self._segments[:, 0], time, side="right")) - 1
        segment = self._segments[max(i, 0)]
        begin, rate, normal, axis = segment[0], segment[1], segment[2:5], segment[5:8]
        turned = _rotate(normal, axis, rate * (time - begin))
        return level_state(turned, rate * np.cross(axis, turned), np.array(self.height))


def _rotate(vector: Array, axis: Array, angle: float) -> Array:
    """Return a vector turned about a unit axis (Rodrigues)."""
    c, s = math.cos(angle), math.sin(angle)
    turned: Array = c * vector + s * np.cross(axis, vector) + (1 - c) * (axis @ vector) * axis
    return turned


def _segments(normals: Array, axes: Array, lengths: Array, rate: float, turn_rate: float) -> Array:
    """Return rows of begin [s], rate of rotation [rad/s], normal then and axis: leg, turn, leg, turn, ..., leg."""
    inner = normals[1:-1]
    before, behind = np.cross(axes[:-1], inner), np.cross(axes[1:], inner)
    left = np.einsum("ki,ki->k", axes[:-1], behind)
    turns = np.arctan2(left, np.einsum("ki,ki->k", before, behind))
    if np.any(np.abs(turns) > REVERSAL):
        at = int(np.argmax(np.abs(turns) > REVERSAL)) + 1
        raise ValueError(f"waypoints: at {at} the course is reversed; a turn of less than 180 deg is needed")
    with np.errstate(over="ignore"):
        sines = rate / turn_rate * np.abs(np.tan(turns / 2))
    radius = math.atan(rate / turn_rate)
    cut = np.concatenate([[0.0], np.where(sines < 1, np.arcsin(np.minimum(sines, 1.0)), np.inf), [0.0]])
    for i, length in enumerate(lengths):
        if cut[i] + cut[i + 1] > length:
            raise ValueError(
                f"waypoints: the leg from {i} to {i + 1}, {math.degrees(length):g} deg, is too short for its turns at "
                f"{math.degrees(turn_rate):g} deg/s"
            )
    rows, time, normal = [], 0.0, normals[0]
    for i, axis in enumerate(axes):
        rows.append(np.concatenate([[time, rate], normal, axis]))
        straight = lengths[i] - cut[i] - cut[i + 1]
        time, normal = time + straight / rate, _rotate(normal, axis, straight)
        if i < len(turns):
            side = math.copysign(1.0, turns[i])
            centre = side * math.cos(radius) * normal + math.sin(radius) * axis
            end = math.cos(cut[i + 1]) * inner[i] + math.sin(cut[i + 1]) * behind[i]
            fast = rate / math.sin(radius)
            rows.append(np.concatenate([[time, fast], normal, centre]))
            swept = math.atan2(centre @ np.cross(normal, end), normal @ end - (centre @ normal) * (centre @ end))
            time, normal = time + max(swept, 0.0) / fast, end
    return np.array(rows)
