"""The map of bearings from one observer: where beside its path a target can be located, and how well."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.map import BoundMap, Plane
from quietfix.diagrams.quantities.frame import LOCAL
from quietfix.systems.angles.bearing import Bearing
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.bearing_start import BearingStart

__all__ = ["bearing_map"]

Array = NDArray[np.float64]

_KM = 1e3
_POINTS = 50  # even: none is on a straight path through the middle
_NEAREST = 1e3  # m; a target nearer than this to the observer is not mapped


def bearing_map(
    times: Array,
    path: Array,
    target: Array,
    motion: MotionModel,
    model: Bearing,
    start: BearingStart,
    words: str,
    points: int | None = None,
) -> BoundMap:
    """Return the map over places of the target at the first epoch.

    Parameters
    ----------
    times : ndarray, shape (time,)
        Epochs [s].
    path : ndarray, shape (time, 6)
        The observer, in local axes.
    target : ndarray, shape (n,)
        The target at the first epoch; that of a point has the point's place.
    motion : MotionModel
        Of the target.
    model : Bearing
        As it is believed to be.
    start : BearingStart
        What is assumed of the range, and of the velocity.
    words : str
        What the targets are.
    points : int, optional
        Along either side of the map, which reaches to the assumed range around the path.
    """
    middle = 0.5 * (path[:, :2].min(axis=0) + path[:, :2].max(axis=0))
    half = 0.5 * np.ptp(path[:, :2], axis=0).max() + start.distance
    offsets = np.linspace(-half, half, points or _POINTS)
    x, y = (middle[0] + offsets), (middle[1] + offsets)
    north, east = np.meshgrid(y, x, indexing="ij")
    state = np.broadcast_to(target, (*north.shape, target.size)).copy()
    state[..., 0], state[..., 1] = east, north
    states = [state]
    for dt in np.diff(times):
        states.append(motion.propagate(states[-1], float(dt)))
    truth = np.stack(states, axis=-2)
    distance = np.linalg.norm(truth[..., :2] - path[:, :2], axis=-1)
    seen = distance.min(axis=-1) > _NEAREST
    axes = int(model.size + 1)
    known = f"{start.sigma_distance / _KM:g} km in range, the first bearing across it"
    return BoundMap(
        plane=Plane(("north", "east"), ("y, north [km]", "x, east [km]"), (y / _KM, x / _KM)),
        seen=seen,
        truth=truth[seen],
        platforms=path[None, :, None, :],
        times=times,
        sets={" + ".join(model.names): model},
        motion=motion,
        prior=start.covariance_at(truth[seen][:, 0], path[None, 0, None, :]),
        stated={
            "noise": "none",
            "prior": known + (f", {start.sigma_velocity:g} m/s per axis" if motion.size > axes else ""),
            "target": words,
        },
        track=path[:, None, 1::-1] / _KM,
        track_labels=("path of the observer",),
        first_epoch_used=True,
        quantities=("position",) if axes == 2 else ("position", "height"),
        frame=LOCAL,
    )
