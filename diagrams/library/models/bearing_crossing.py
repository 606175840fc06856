"""What `bearing_crossing` makes of its scenario: paths, sensor, start, what is refused, and the map of its bound."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.map import BoundMap
from quietfix.diagrams.library.fields.bearing_crossing import Scenario, Waypoints
from quietfix.diagrams.maps.bearing import bearing_map
from quietfix.diagrams.parts.sensor_errors import NO_CLOCKS, refuse
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.angles.bearing import Bearing
from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.motion.constant_velocity import ConstantVelocity
from quietfix.systems.motion.stationary import Stationary
from quietfix.systems.starts.bearing_start import BearingStart
from quietfix.systems.trajectories.waypoints import WaypointPath

__all__ = [
    "axes_of",
    "bearing_start",
    "believed_sensor",
    "bound_map",
    "check_errors",
    "check_geometry",
    "check_rows",
    "observer_path",
    "sensor_model",
    "target_motion",
    "target_state",
]

Array = NDArray[np.float64]

_KM = 1e3
_KMPH = 1 / 3.6
_UNDER = 1.0  # m; nearer than this there is no bearing
_PARALLEL = 1e-6  # rad


def _pair(value: Sequence[float], field: str) -> Array:
    if len(value) != 2 or not np.all(np.isfinite(value)):
        raise UserError(f"{field}: {list(value)} is not allowed; two finite numbers, x and y")
    return _KM * np.array(value, dtype=float)


def observer_path(scenario: Scenario) -> Callable[[float | Array], Array]:
    """Return a function from time (...) [s] to the observer's state (..., 6)."""
    observer, height = scenario.truth.observer, scenario.truth.observer_height_km * _KM
    if isinstance(observer, Waypoints):
        points = [_pair(p, f"truth.observer.points_km.{i}") for i, p in enumerate(observer.points_km)]
        if len(points) < 2:
            raise UserError(f"truth.observer.points_km: {len(points)} are given; at least 2 are needed")
        rate = math.radians(observer.turn_rate_degps)
    else:
        begin = _pair(observer.position_km, "truth.observer.position_km")
        course = math.radians(observer.course_deg)
        points, rate = [begin, begin + _KM * np.array([math.sin(course), math.cos(course)])], 1.0
    try:
        return WaypointPath(np.array(points), observer.speed_kmph * _KMPH, rate, height).at
    except ValueError as error:
        raise UserError(f"truth.observer.points_km: {error}") from error


def axes_of(scenario: Scenario) -> int:
    """Return 2 in the plane, 3 where an elevation is measured."""
    return 2 if scenario.truth.sigma_elevation_deg is None else 3


def target_state(scenario: Scenario) -> Array:
    """Return the target's state at t = 0: x, y, with elevation z, and the velocity of one that may move."""
    truth, axes = scenario.truth, axes_of(scenario)
    if truth.target_speed_mps > 0 and scenario.belief.target == "fixed":
        raise UserError(
            f"truth.target_speed_mps: {truth.target_speed_mps:g} is not allowed for belief.target fixed; moving"
        )
    course = math.radians(truth.target_course_deg)
    position = np.append(_pair(truth.target_km, "truth.target_km"), truth.target_height_km * _KM)[:axes]
    velocity = truth.target_speed_mps * np.array([math.sin(course), math.cos(course), 0.0])[:axes]
    return position if scenario.belief.target == "fixed" else np.concatenate([position, velocity])


def target_motion(scenario: Scenario) -> MotionModel:
    """Return how the target moves, and how the estimators believe that it does."""
    axes = axes_of(scenario)
    return Stationary(axes) if scenario.belief.target == "fixed" else ConstantVelocity(0.0, axes)


def sensor_model(scenario: Scenario, believed: bool) -> Bearing:
    """Return the sensor, of the truth or as the estimators believe it to be."""
    truth, belief = scenario.truth, scenario.belief

    def chosen(field: str) -> float | None:
        real = getattr(truth, field)
        value = getattr(belief, field) if believed and real is not None else None
        return real if value is None else value

    sigma, elevation = chosen("sigma_bearing_deg"), chosen("sigma_elevation_deg")
    assert sigma is not None
    return Bearing(math.radians(sigma), None if elevation is None else math.radians(elevation))


def believed_sensor(scenario: Scenario) -> Bearing:
    """Return the sensor as the estimators believe it to be."""
    return sensor_model(scenario, believed=True)


def check_geometry(scenario: Scenario, path: Callable[[Array], Array], motion: MotionModel) -> None:
    """Refuse what no bearing can locate."""
    if scenario.duration_s < scenario.period_s:
        raise UserError(
            f"duration_s: {scenario.duration_s:g} is not allowed; a single bearing locates nothing, at least period_s "
            f"({scenario.period_s:g}) is needed"
        )
    times = Periodic(scenario.period_s).ticks(scenario.duration_s)
    state = target_state(scenario)
    target = np.stack([motion.propagate(state, t) for t in times])
    offset = target[:, :2] - path(times)[:, :2]
    distance = np.hypot(offset[:, 0], offset[:, 1])
    if distance.min() < _UNDER:
        raise UserError(
            f"truth.target_km: {scenario.truth.target_km} is not allowed; the target is under the observer at "
            f"{times[distance.argmin()]:g} s, where it has no bearing"
        )
    azimuth = np.arctan2(offset[:, 1], offset[:, 0])
    if np.abs(np.sin(azimuth - azimuth[0])).max() < _PARALLEL:
        raise UserError(
            f"truth.target_km: {scenario.truth.target_km} is not allowed; the observer flies towards the target or "
            "away from it, and all bearings are parallel"
        )


def bearing_start(scenario: Scenario, model: Bearing, motion: MotionModel) -> BearingStart:
    """Return how the estimators begin: on the first bearing, at the range that the scenario assumes."""
    belief = scenario.belief
    return BearingStart(
        model, model.names, motion.size, belief.range_km * _KM, belief.sigma_range_km * _KM, belief.sigma_speed_mps
    )


def bound_map(scenario: Scenario, points: int | None = None) -> BoundMap:
    """Return the map of the bound over places of the target at t = 0, around the observer's path; see `bearing_map`."""
    times = Periodic(scenario.period_s).ticks(scenario.duration_s)
    motion, model, truth = target_motion(scenario), believed_sensor(scenario), scenario.truth
    path, start = observer_path(scenario)(times), bearing_start(scenario, model, motion)
    moving = f"{truth.target_speed_mps:g} m/s, course {truth.target_course_deg:g} deg"
    words = "at rest" if truth.target_speed_mps == 0 else moving
    return bearing_map(times, path, target_state(scenario), motion, model, start, words, points)


def check_errors(scenario: Scenario) -> None:
    """Refuse errors that bearings do not have."""
    refused = {**NO_CLOCKS, "platform": "truth.sigma_navigation_m says how well the observer is known"}
    if axes_of(scenario) == 2:
        refused |= dict.fromkeys(("attitude_roll", "attitude_pitch"), "bearings in the plane turn about z only")
    refuse(scenario.truth.errors, "truth.errors", refused)


def check_rows(name: str, options: EstimatorOptions, model: Bearing) -> None:
    """Refuse rows that are not measured, and fewer than are."""
    unknown = [kind for kind in options.measurements if kind not in model.names]
    if unknown or (options.measurements and len(options.measurements) < model.size):
        raise UserError(
            f"estimators.{name}.measurements: {options.measurements} is not allowed; {', '.join(model.names)}, or empty"
        )
