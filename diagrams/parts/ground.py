"""Places on the ground, counted along and across the track of the first satellite."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.diagrams.parts.formation import Formation
from quietfix.systems.earth.frames import inertial_to_earth_fixed
from quietfix.systems.earth.geodetic import ecef_to_geodetic, geodetic_state
from quietfix.systems.plants.orbit import DenseOrbit

__all__ = ["Airborne", "AirborneTruth", "beside_track", "track_axes", "tracks"]

Array = NDArray[np.float64]

_KM = 1e3


class AirborneTruth(Protocol):
    """How high, how fast and where to a target flies."""

    height_km: float
    speed_mps: float
    course_deg: float


class Airborne(Formation, Protocol):
    """What a scenario with satellites and an airborne target has."""

    period_s: float

    @property
    def truth(self) -> AirborneTruth:
        """The truth."""


def track_axes(scenario: Formation, orbit: DenseOrbit) -> Array:
    """Return the axes that places of the target are counted in, shape (3, 3), Earth-fixed.

    Rows: along the ground track of satellite 0 (Earth-fixed velocity) at half the duration, to the right of it, up.
    """
    middle = scenario.duration_s / 2
    state = inertial_to_earth_fixed(orbit.at(middle)[0], middle, scenario.constants.earth_rate_radps)
    up_ = state[:3] / np.linalg.norm(state[:3])
    forward = state[3:] - up_ * (up_ @ state[3:])
    forward /= np.linalg.norm(forward)
    return np.stack([forward, np.cross(forward, up_), up_])


def beside_track(scenario: Airborne, orbit: DenseOrbit, along_km: ArrayLike, cross_km: ArrayLike) -> Array:
    """Return the Earth-fixed state at t = 0 of targets beside the ground track, shape (..., 6).

    Parameters
    ----------
    scenario : Airborne
        Height, speed and course.
    orbit : DenseOrbit
        The satellites.
    along_km, cross_km : array_like, shape (...)
        Place [km], counted from the sub-satellite point of satellite 0 along and to the right of its track (see
        `track_axes`), on a sphere through that point.
    """
    truth, radius = scenario.truth, scenario.constants.earth_radius_m
    forward, right, up_ = track_axes(scenario, orbit)
    along = np.asarray(along_km)[..., None] * _KM / radius
    cross = np.asarray(cross_km)[..., None] * _KM / radius
    ahead = np.cos(along) * up_ + np.sin(along) * forward
    latitude, longitude, _ = ecef_to_geodetic(radius * (np.cos(cross) * ahead + np.sin(cross) * right))
    return geodetic_state(latitude, longitude, truth.height_km * _KM, math.radians(truth.course_deg), truth.speed_mps)


def tracks(scenario: Formation, axes: Array, platforms: Array) -> Array:
    """Return where the satellites stand on the map, (time, satellites, 2) [km]; the inverse of `beside_track`."""
    direction = platforms[..., :3] / np.linalg.norm(platforms[..., :3], axis=-1, keepdims=True)
    forward, right, upward = np.moveaxis(direction @ axes.T, -1, 0)
    radius = scenario.constants.earth_radius_m / 1e3
    return radius * np.stack([np.arctan2(forward, upward), np.arcsin(right)], axis=-1)
