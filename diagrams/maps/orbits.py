"""The map of satellite to satellite: how well another satellite's orbit can be known, by which orbit it is in."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.map import BoundMap, Plane
from quietfix.diagrams.quantities.frame import INERTIAL
from quietfix.systems.geometry.visibility import Mask
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.orbital import OrbitalMotion

__all__ = ["orbit_map"]

Array = NDArray[np.float64]

_POINTS = (19, 25)  # of the inclination, and of the mean anomaly
_NEAREST = 10e3  # m; a target that comes nearer to the observer is not mapped


def orbit_map(
    times: Array,
    observer: Array,
    target: Callable[[float, float], Array],
    flight: OrbitalMotion,
    mask: Mask | None,
    sets: Mapping[str, MeasurementModel],
    motion: OrbitalMotion,
    prior: Array,
    stated: Mapping[str, str],
    mark: tuple[float, float],
    points: tuple[int, int] | None = None,
) -> BoundMap:
    """Return the map over inclination and phase of the target's orbit.

    Parameters
    ----------
    times : ndarray, shape (time,)
        Epochs [s].
    observer : ndarray, shape (6,)
        At the first epoch, inertial.
    target : callable
        ``(inclination, mean anomaly) -> (6,)`` at the first epoch, of [deg]: the other elements are the same.
    flight : OrbitalMotion
        How both really move.
    mask : Mask, optional
        What hides the target.
    sets, motion, prior, stated
        See `BoundMap`.
    mark : (float, float)
        Inclination and mean anomaly of the scenario's target [deg].
    points : (int, int), optional
        Of the inclination, 0 to 180 deg, and of the mean anomaly, -180 to 180 deg.
    """
    steps = points or _POINTS
    inclination, phase = np.linspace(0.0, 180.0, steps[0]), np.linspace(-180.0, 180.0, steps[1])
    start = np.array([[target(float(i), float(m)) for m in phase] for i in inclination])
    flown, targets = [observer], [start]
    for dt in np.diff(times):
        flown.append(flight.propagate(flown[-1], float(dt)))
        targets.append(flight.propagate(targets[-1], float(dt)))
    truth, platforms = np.stack(targets, axis=-2), np.stack(flown)[None, :, None, :]
    seen = np.linalg.norm(truth[..., :3] - platforms[0, :, 0, :3], axis=-1).min(axis=-1) > _NEAREST
    return BoundMap(
        plane=Plane(
            ("inclination", "phase"),
            ("inclination of the target's orbit [deg]", "mean anomaly of the target at t = 0 [deg]"),
            (inclination, phase),
        ),
        seen=seen,
        truth=truth[seen],
        platforms=platforms,
        times=times,
        sets=sets,
        motion=motion,
        prior=prior,
        stated=stated,
        points=np.array([mark]),
        points_label="the scenario's target",
        present=None if mask is None else mask.visible(truth[seen], platforms),
        quantities=("position", "velocity"),
        frame=INERTIAL,
        equal=False,
    )
