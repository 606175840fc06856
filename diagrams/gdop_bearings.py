"""The map of `bearing_crossing`: where beside the observer's path a target can be located, and how well."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from diagrams.bearing_crossing import Scenario, believed_sensor, observer_path, target_motion, target_state
from diagrams.bound_map import BoundMap, Plane
from systems.clocks import Periodic
from systems.estimators.bearing_start import BearingStart

__all__ = ["bearing_map"]

Array = NDArray[np.float64]

_KM = 1e3
_POINTS = 50  # even: none is on a straight path through the middle
_NEAREST = 1e3  # m; a target nearer than this to the observer is not mapped


def bearing_map(scenario: Scenario, points: int = _POINTS) -> BoundMap:
    """Return the map of `bearing_crossing` over places of the target at t = 0.

    Parameters
    ----------
    scenario : Scenario
        The observer's path, the target's velocity, noise and what is assumed of the range.
    points : int
        Along either side of the map, which reaches to the assumed range around the path.
    """
    times = Periodic(scenario.period_s).ticks(scenario.duration_s)
    path = observer_path(scenario)(times)
    motion, model, belief = target_motion(scenario), believed_sensor(scenario), scenario.belief
    target = target_state(scenario)
    axes = int(model.size + 1)
    middle = 0.5 * (path[:, :2].min(axis=0) + path[:, :2].max(axis=0))
    half = 0.5 * np.ptp(path[:, :2], axis=0).max() + belief.range_km * _KM
    offsets = np.linspace(-half, half, points)
    x, y = (middle[0] + offsets), (middle[1] + offsets)
    north, east = np.meshgrid(y, x, indexing="ij")
    start = np.broadcast_to(target, (*north.shape, target.size)).copy()
    start[..., 0], start[..., 1] = east, north
    states = [start]
    for dt in np.diff(times):
        states.append(motion.propagate(states[-1], float(dt)))
    truth = np.stack(states, axis=-2)
    distance = np.linalg.norm(truth[..., :2] - path[:, :2], axis=-1)
    seen = distance.min(axis=-1) > _NEAREST
    first = BearingStart(
        model, model.names, motion.size, belief.range_km * _KM, belief.sigma_range_km * _KM, belief.sigma_speed_mps
    )
    moving = motion.size > axes
    words = f"{belief.sigma_range_km:g} km in range, the first bearing across it"
    return BoundMap(
        plane=Plane(("north", "east"), ("y, north [km]", "x, east [km]"), (y / _KM, x / _KM)),
        seen=seen,
        truth=truth[seen],
        platforms=path[None, :, None, :],
        times=times,
        sets={" + ".join(model.names): model},
        motion=motion,
        prior=first.covariance_at(truth[seen][:, 0], path[None, 0, None, :]),
        stated={
            "noise": "none",
            "prior": words + (f", {belief.sigma_speed_mps:g} m/s per axis" if moving else ""),
            "target": "at rest"
            if scenario.truth.target_speed_mps == 0
            else f"{scenario.truth.target_speed_mps:g} m/s, course {scenario.truth.target_course_deg:g} deg",
        },
        track=path[:, None, 1::-1] / _KM,
        track_labels=("path of the observer",),
        first_epoch_used=True,
        quantities=("position",) if axes == 2 else ("position", "height"),
        frame="local",
    )
