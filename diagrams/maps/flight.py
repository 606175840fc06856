"""The map of a flight: how well stations know a vehicle, by its place in the plane of the flight."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.map import BoundMap, Plane
from quietfix.diagrams.quantities.frame import LAUNCH
from quietfix.systems.clocks import Periodic
from quietfix.systems.geometry.visibility import SphericalMask
from quietfix.systems.measurement.range_rate import RangeRate
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.trajectories.rocket import LaunchSite

__all__ = ["flight_map"]

Array = NDArray[np.float64]

_KM = 1e3
_POINTS = (21, 31)  # upwards and down-range
_WINDOW = 5.0  # s
_POSITION, _VELOCITY = 1e3, 100.0  # m and m/s per axis, of the prior
_MARGIN = 0.15  # of the flight's extent, around it


def flight_map(
    flown: Array,
    site: LaunchSite,
    stations: Array,
    names: Sequence[str],
    clock: Periodic,
    model: RangeRate,
    motion: MotionModel,
    mask: SphericalMask | None,
    sigma_acceleration: float,
    sigma_bias: float,
    noise: str,
    points: tuple[int, int] | None = None,
) -> BoundMap:
    """Return the map in the launch frame's X-Y plane, after five seconds.

    A vehicle at a point has the velocity, acceleration and place across that the flight has where it is as far
    down-range, so that on the flight the map shows the flight.

    Parameters
    ----------
    flown : ndarray, shape (steps, 9)
        Position, velocity and acceleration along the flight.
    site : LaunchSite
    stations : ndarray, shape (p, 3)
    names : sequence of str
        Of the stations.
    clock : Periodic
        Of the measurements, from zero on.
    model : RangeRate
        As it is believed to be, with the bias as the tenth state.
    motion : MotionModel
        With the filter's process noise.
    mask : SphericalMask, optional
        What hides the vehicle from a station.
    sigma_acceleration, sigma_bias : float
        Of the prior, per axis [m/s^2], and of the bias [m/s].
    noise : str
        The process noise in words.
    points : (int, int), optional
        Upwards and down-range.
    """
    steps = points or _POINTS
    low, high = flown[:, :2].min(axis=0), flown[:, :2].max(axis=0)
    margin = _MARGIN * (high - low)
    x = np.linspace(low[0], high[0] + margin[0], steps[1])
    y = np.linspace(min(low[1], 0.0) - margin[1], high[1] + margin[1], steps[0])
    up, down_range = np.meshgrid(y, x, indexing="ij")
    # where the flight is as far down-range; before and after it, its ends
    index = np.interp(down_range, np.maximum.accumulate(flown[:, 0]), np.arange(len(flown))).round().astype(int)
    start = flown[index].copy()
    start[..., 0], start[..., 1] = down_range, up

    times = clock.ticks(_WINDOW)
    truth = _accelerated(start, times)
    seen = np.linalg.norm(truth[..., :3] - site.centre, axis=-1).min(axis=-1) > site.radius
    platforms = np.concatenate([stations, np.zeros_like(stations)], axis=-1)[None, None]
    sigmas = [_POSITION] * 3 + [_VELOCITY] * 3 + [sigma_acceleration] * 3 + [sigma_bias]
    return BoundMap(
        plane=Plane(("up", "down_range"), ("Y, up at the site [km]", "X, down-range [km]"), (y / _KM, x / _KM)),
        seen=seen,
        truth=truth[seen],
        platforms=np.broadcast_to(platforms, (1, times.size, *platforms.shape[2:])),
        times=times,
        sets={f"range rates at {len(stations)} stations": model},
        motion=motion,
        prior=np.diag(np.square(sigmas)),
        stated={
            "noise": noise,
            "prior": f"{_POSITION / _KM:g} km, {_VELOCITY:g} m/s, {sigma_acceleration:g} m/s^2 per axis, "
            f"bias {sigma_bias:g} m/s",
            "target": "velocity of the flight as far down-range",
        },
        track=flown[:, None, 1::-1] / _KM,
        track_labels=("the flight",),
        points=stations[:, 1::-1] / _KM,
        points_label="stations, whatever their place across",
        point_names=tuple(names),
        present=None if mask is None else mask.visible(truth[seen], platforms),
        quantities=("position", "velocity"),
        frame=LAUNCH,
    )


def _accelerated(start: Array, times: Array) -> Array:
    """Return states (..., time, 10) of constant acceleration, without bias, from `start` (..., 9)."""
    t = times[:, None]
    place, velocity, acceleration = (start[..., None, i : i + 3] for i in (0, 3, 6))
    parts = [place + velocity * t + 0.5 * acceleration * t**2, velocity + acceleration * t]
    truth = np.concatenate([*parts, np.broadcast_to(acceleration, parts[0].shape)], axis=-1)
    return np.concatenate([truth, np.zeros((*truth.shape[:-1], 1))], axis=-1)
