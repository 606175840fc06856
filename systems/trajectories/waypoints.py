"""A level path through waypoints at constant speed, with turns of constant rate."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.systems.angle_wrapping import wrap

__all__ = ["REVERSAL", "WaypointPath"]

Array = NDArray[np.float64]

REVERSAL = math.pi - 1e-6
"""Turns of more are none [rad]."""


class WaypointPath:
    """Straight legs joined by circular arcs that begin before a waypoint and end behind it ("fly-by").

    The path starts at the first waypoint; behind the last one it goes straight on.

    Parameters
    ----------
    points : array_like, shape (waypoints, 2)
        At least two [m].
    speed : float
        > 0 [m/s].
    turn_rate : float
        > 0 [rad/s]; the radius of every turn is speed over turn rate.
    height : float
        Constant z [m].

    Raises
    ------
    ValueError
        For equal neighbours, a reversal of the course, and turns that do not fit into their legs.
    """

    def __init__(self, points: ArrayLike, speed: float, turn_rate: float, height: float = 0.0) -> None:
        p = np.array(points, dtype=float)
        if p.ndim != 2 or p.shape[-1] != 2 or len(p) < 2 or not np.all(np.isfinite(p)):
            raise ValueError(f"waypoints: shape {np.shape(points)} is not allowed; at least two of x and y, finite")
        for name, value, unit in (("speed", speed, "m/s"), ("turn_rate", turn_rate, "rad/s")):
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"{name}: {value} is not allowed; it must be > 0 {unit}")
        self.speed, self.height = float(speed), float(height)
        legs = np.diff(p, axis=0)
        lengths = np.hypot(legs[:, 0], legs[:, 1])
        if np.any(lengths == 0):
            at = int(np.argmax(lengths == 0))
            raise ValueError(f"waypoints: {at} and {at + 1} are equal")
        courses = np.arctan2(legs[:, 1], legs[:, 0])
        turns = wrap(np.diff(courses))
        if np.any(np.abs(turns) > REVERSAL):
            at = int(np.argmax(np.abs(turns) > REVERSAL)) + 1
            raise ValueError(f"waypoints: at {at} the course is reversed; a turn of less than 180 deg is needed")
        radius = speed / turn_rate
        with np.errstate(over="ignore"):
            cut = np.concatenate([[0.0], radius * np.abs(np.tan(turns / 2)), [0.0]])
        for i, length in enumerate(lengths):
            if cut[i] + cut[i + 1] > length:
                raise ValueError(
                    f"waypoints: the leg from {i} to {i + 1}, {length:g} m, is too short for its turns "
                    f"({cut[i] + cut[i + 1]:g} m at {math.degrees(turn_rate):g} deg/s)"
                )
        self._segments = _segments(p[0], courses, lengths, turns, cut, radius)

    def at(self, time: ArrayLike) -> Array:
        """Return position [m] and velocity [m/s], shape (..., 6), at times (...) [s] >= 0."""
        t = np.asarray(time, dtype=float)
        s = self.speed * t
        start = self._segments[:, 0]
        segment = self._segments[np.clip(np.searchsorted(start, s, side="right") - 1, 0, len(start) - 1)]
        begin, x, y, course, curvature = np.moveaxis(segment, -1, 0)
        along = s - begin
        turned = course + curvature * along
        half = 0.5 * curvature * along
        # The chord of an arc; a straight leg is one of curvature zero.
        chord = along * np.sinc(half / np.pi)
        state = np.zeros((*t.shape, 6))
        state[..., 0] = x + chord * np.cos(course + half)
        state[..., 1] = y + chord * np.sin(course + half)
        state[..., 2] = self.height
        state[..., 3] = self.speed * np.cos(turned)
        state[..., 4] = self.speed * np.sin(turned)
        return state


def _segments(origin: Array, courses: Array, lengths: Array, turns: Array, cut: Array, radius: float) -> Array:
    """Return rows of begin along the path, x, y, course there, curvature: leg, turn, leg, turn, ..., leg."""
    rows: list[Sequence[float]] = []
    s, x, y = 0.0, float(origin[0]), float(origin[1])
    for i, course in enumerate(courses):
        rows.append((s, x, y, course, 0.0))
        straight = lengths[i] - cut[i] - cut[i + 1]
        s, x, y = s + straight, x + straight * math.cos(course), y + straight * math.sin(course)
        if i < len(turns):
            curvature = math.copysign(1 / radius, turns[i])
            rows.append((s, x, y, course, curvature))
            reach = 2 * radius * math.sin(abs(turns[i]) / 2)
            middle = course + turns[i] / 2
            s += radius * abs(turns[i])
            x, y = x + reach * math.cos(middle), y + reach * math.sin(middle)
    return np.array(rows)
