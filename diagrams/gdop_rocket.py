"""The map of `beacon_rocket`: how well the stations know a vehicle, by its place in the plane of the flight."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from diagrams.beacon_rocket import Scenario, believed_motion, believed_sensor, sensor_mask
from diagrams.bound_map import BoundMap, Plane
from diagrams.launch import launch_site, station_positions, vehicle_block
from systems.clocks import Periodic

__all__ = ["rocket_map"]

Array = NDArray[np.float64]

_KM = 1e3
_WINDOW = 5.0  # s
_POSITION, _VELOCITY = 1e3, 100.0  # m and m/s per axis, of the prior
_MARGIN = 0.15  # of the flight's extent, around it
_FLOWN = 400  # points of the flight


def rocket_map(scenario: Scenario, points: tuple[int, int] = (21, 31)) -> BoundMap:
    """Return the map of `beacon_rocket` in the launch frame's X-Y plane, after five seconds.

    A vehicle at a point has the velocity, acceleration and place across that the flight has where it is as far
    down-range, so that on the flight the map shows the flight.

    Parameters
    ----------
    scenario : Scenario
        Flight, stations, noise, and the filter's process noise.
    points : (int, int)
        Upwards and down-range.
    """
    vehicle = vehicle_block(scenario)
    model, motion = believed_sensor(scenario), believed_motion(scenario, vehicle)
    flown_at = np.linspace(scenario.start_s, scenario.stop_s, _FLOWN)
    flown = np.array([np.concatenate(vehicle.at(float(t))) for t in flown_at])
    low, high = flown[:, :2].min(axis=0), flown[:, :2].max(axis=0)
    margin = _MARGIN * (high - low)
    x = np.linspace(low[0], high[0] + margin[0], points[1])
    y = np.linspace(min(low[1], 0.0) - margin[1], high[1] + margin[1], points[0])
    up, down_range = np.meshgrid(y, x, indexing="ij")
    # where the flight is as far down-range; before and after it, its ends
    index = np.interp(down_range, np.maximum.accumulate(flown[:, 0]), np.arange(_FLOWN)).round().astype(int)
    start = flown[index].copy()
    start[..., 0], start[..., 1] = down_range, up

    times = Periodic(scenario.period_s).ticks(_WINDOW)
    t = times[:, None]
    place, velocity, acceleration = (start[..., None, i : i + 3] for i in (0, 3, 6))
    parts = [place + velocity * t + 0.5 * acceleration * t**2, velocity + acceleration * t]
    truth = np.concatenate([*parts, np.broadcast_to(acceleration, parts[0].shape)], axis=-1)
    truth = np.concatenate([truth, np.zeros((*truth.shape[:-1], 1))], axis=-1)
    site = launch_site(scenario)
    seen = np.linalg.norm(truth[..., :3] - site.centre, axis=-1).min(axis=-1) > site.radius
    stations = station_positions(scenario)
    platforms = np.concatenate([stations, np.zeros_like(stations)], axis=-1)[None, None]
    mask, belief = sensor_mask(scenario), scenario.belief
    sigmas = [_POSITION] * 3 + [_VELOCITY] * 3 + [belief.sigma_acceleration_mps2] * 3 + [belief.sigma_bias_mps]
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
            "noise": f"current statistical model, {belief.alpha_hz:g} 1/s",
            "prior": f"{_POSITION / _KM:g} km, {_VELOCITY:g} m/s, {belief.sigma_acceleration_mps2:g} m/s^2 per axis, "
            f"bias {belief.sigma_bias_mps:g} m/s",
            "target": "velocity of the flight as far down-range",
        },
        track=flown[:, None, 1::-1] / _KM,
        track_labels=("the flight",),
        points=stations[:, 1::-1] / _KM,
        points_label="stations, whatever their place across",
        present=None if mask is None else mask.visible(truth[seen], platforms),
        quantities=("position", "velocity"),
        frame="launch",
    )
