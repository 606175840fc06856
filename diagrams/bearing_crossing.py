"""One aircraft locates a target by bearings alone.

Huang, *Bearing cross location algorithm based on piecewise linear Kalman filter*, Modern Defence Technology 45 (2017)
no. 1, 113-118, doi 10.3969/j.issn.1009-086x.2017.01.020.

A local frame: x east, y north, z up. Azimuths are counter-clockwise from x in radians inside; courses and bearings
clockwise from north in degrees where people read and write.
"""

# No `from __future__ import annotations` here: Drake's YAML loader needs the types themselves.
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Union, cast

import numpy as np
from numpy.typing import NDArray

from diagrams.assembly.bus import Bus
from diagrams.assembly.map import BoundMap
from diagrams.assembly.model import Assumed, Model
from diagrams.assembly.system import System, packaged
from diagrams.errors import UserError, choose
from diagrams.maps.bearing import bearing_map
from diagrams.parts.impairment import Impaired, Mount, NavigationError
from diagrams.parts.movers import ModelTarget, Platforms
from diagrams.parts.sensing import TargetSensor
from diagrams.sensor_errors import NO_CLOCKS, SensorErrors, refuse
from systems.clocks import Clock, Periodic
from systems.documented import choice, documented, number
from systems.estimators.azimuth_filter import AzimuthFilter, AzimuthFilterOptions
from systems.estimators.base import Wiring
from systems.estimators.bearing_start import BearingStart
from systems.estimators.options import EstimatorOptions
from systems.measurement.bearing import Bearing
from systems.motion.base import MotionModel
from systems.motion.constant_velocity import ConstantVelocity
from systems.motion.stationary import Stationary
from systems.motion.waypoints import WaypointPath
from systems.plants.path import Path
from systems.registry import estimator_options

__all__ = ["SYSTEM", "Scenario", "believed_sensor", "bound_map", "observer_path", "target_motion", "target_state"]

Array = NDArray[np.float64]

if TYPE_CHECKING:
    EstimatorChoice = EstimatorOptions
else:
    EstimatorChoice = Union[estimator_options()]  # noqa: UP007 - the members come from the registry

_KM = 1e3
_KMPH = 1 / 3.6
_UNDER = 1.0  # m; nearer than this there is no bearing
_PARALLEL = 1e-6  # rad


@dataclass
class Straight:
    """The observer flies straight on."""

    position_km: list[float] = documented("x (east) and y (north) at t = 0 [km]", factory=lambda: [0.0, 0.0])
    course_deg: float = number("course clockwise from north [deg]", 90.0)
    speed_kmph: float = number("speed [km/h]", 600.0, above=0)


@dataclass
class Waypoints:
    """The observer flies by waypoints, at constant speed and with turns of constant rate."""

    points_km: list[list[float]] = documented("x (east) and y (north) of each waypoint [km]", factory=list)
    speed_kmph: float = number("speed [km/h]", 600.0, above=0)
    turn_rate_degps: float = number("rate of the turns [deg/s]", 3.0, above=0)


@dataclass
class Truth:
    """What is the case."""

    observer: Straight | Waypoints = documented("path of the observer: !Straight or !Waypoints", factory=Straight)
    observer_height_km: float = number("height of the observer; only read where elevation is measured [km]", 8.0)
    target_km: list[float] = documented(
        "x (east) and y (north) of the target at t = 0 [km]", factory=lambda: [10.0, 50.0]
    )
    target_height_km: float = number("height of the target; only read where elevation is measured [km]", 0.0)
    target_course_deg: float = number("course of the target, clockwise from north [deg]", 0.0)
    target_speed_mps: float = number("speed of the target; 0 is a fixed one [m/s]", 0.0, at_least=0)
    target_spread_km: float = number(
        "standard deviation per axis by which the target's place differs from trial to trial [km]", 0.0, at_least=0
    )
    sigma_bearing_deg: float = number("standard deviation of a bearing [deg]", 2.0, above=0)
    sigma_elevation_deg: float | None = number("that of an elevation [deg]; null: none is measured", None, above=0)
    sigma_navigation_m: float = number(
        "error of the observer's position per axis, as the estimators know it [m]", 0.0, at_least=0
    )
    navigation_time_s: float = number("correlation time of that error [s]; 0: new at every epoch", 0.0, at_least=0)
    errors: SensorErrors = documented(
        "errors of the sensor that the estimators do not know of; attitude_yaw_deg: of the heading, counter-clockwise",
        factory=SensorErrors,
    )


@dataclass
class Belief:
    """What the estimators believe; null means: as the truth."""

    target: str = choice("fixed: its position is estimated; moving: its velocity too", "fixed", ("fixed", "moving"))
    range_km: float = number("range assumed on the first bearing [km]", 60.0, above=0)
    sigma_range_km: float = number("standard deviation of that range [km]", 30.0, above=0)
    sigma_speed_mps: float = number(
        "velocity of a moving target at the start is 0 with this standard deviation per axis [m/s]", 15.0, above=0
    )
    sigma_bearing_deg: float | None = number("standard deviation of a bearing [deg]", None, above=0)
    sigma_elevation_deg: float | None = number("standard deviation of an elevation [deg]", None, above=0)


@dataclass
class Scenario:
    """Scenario of `bearing_crossing`."""

    duration_s: float = number("length of the run [s]", 1000.0, above=0)
    period_s: float = number("time between bearings [s]", 1.0, above=0)
    divergence_m: float = number("a trial further off than this at the end has diverged [m]", 20e3, above=0)
    truth: Truth = documented("what is the case", factory=Truth)
    belief: Belief = documented("what the estimators believe", factory=Belief)
    azimuth_filters: dict[str, AzimuthFilterOptions] = documented(
        "linear Kalman filters of the azimuth, by name; a crossing locator's `bearings` says which one it uses",
        factory=dict,
    )
    estimators: dict[str, EstimatorChoice] = documented("the estimators side by side", factory=dict)


# ------------------------------------------------------------------------------------------------ geometry


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


def _axes(scenario: Scenario) -> int:
    return 2 if scenario.truth.sigma_elevation_deg is None else 3


def target_state(scenario: Scenario) -> Array:
    """Return the target's state at t = 0: x, y, with elevation z, and the velocity of one that may move."""
    truth, axes = scenario.truth, _axes(scenario)
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
    axes = _axes(scenario)
    return Stationary(axes) if scenario.belief.target == "fixed" else ConstantVelocity(0.0, axes)


def _sensor_model(scenario: Scenario, believed: bool) -> Bearing:
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
    return _sensor_model(scenario, believed=True)


def _check_geometry(scenario: Scenario, path: Callable[[Array], Array], motion: MotionModel) -> None:
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


# ------------------------------------------------------------------------------------------------ declared


def declare(scenario: Scenario) -> Model:
    """Return observer, target, sensor, azimuth filters and what the estimators are given; see `diagrams.assembly`."""
    path, motion, axes = observer_path(scenario), target_motion(scenario), _axes(scenario)
    _check_geometry(scenario, path, motion)
    truth, clock = scenario.truth, Periodic(scenario.period_s)
    _check_errors(scenario)
    spread = truth.target_spread_km * _KM
    place = np.diag([spread**2] * axes + [0.0] * (motion.size - axes))
    real, model = (_sensor_model(scenario, believed) for believed in (False, True))
    start = _start(scenario, model, motion)

    def assume(bus: Bus, name: str, options: EstimatorOptions) -> Assumed:
        _check_rows(name, options, model)
        source = getattr(options, "bearings", "raw")
        if source == "raw":
            return Assumed(model, motion, start, model.names)
        filtered = _azimuth_filter(scenario, bus, name, source, clock)
        takes = {"measurement": f"{source}.bearing", "noise_covariance": f"{source}.bearing_covariance"}
        return Assumed(model, motion, start, filtered.motion.names, takes)

    return Model(
        clock=clock,
        duration=scenario.duration_s,
        divergence=scenario.divergence_m,
        parts=[
            Platforms(lambda: Path(path)),
            ModelTarget(motion, clock, target_state(scenario), place, shared=spread == 0),
            TargetSensor("sensor", real, clock, gives=["measured"]),
            Impaired(real, clock, truth.errors, mounts=[Mount(real.names)], axes=axes),
            NavigationError(truth.sigma_navigation_m, truth.navigation_time_s, clock, axes),
        ],
        assume=assume,
        truth_motion=motion,
        signals={name: f"{name}.estimate" for name in scenario.azimuth_filters},
        platforms=("observer",),
        frame="local",
        rows=model.names,
        map=partial(bound_map, scenario),
    )


def _start(scenario: Scenario, model: Bearing, motion: MotionModel) -> BearingStart:
    belief = scenario.belief
    return BearingStart(
        model, model.names, motion.size, belief.range_km * _KM, belief.sigma_range_km * _KM, belief.sigma_speed_mps
    )


def bound_map(scenario: Scenario, points: int | None = None) -> BoundMap:
    """Return the map of the bound over places of the target at t = 0, around the observer's path; see `bearing_map`."""
    times = Periodic(scenario.period_s).ticks(scenario.duration_s)
    motion, model, truth = target_motion(scenario), believed_sensor(scenario), scenario.truth
    path, start = observer_path(scenario)(times), _start(scenario, model, motion)
    moving = f"{truth.target_speed_mps:g} m/s, course {truth.target_course_deg:g} deg"
    words = "at rest" if truth.target_speed_mps == 0 else moving
    return bearing_map(times, path, target_state(scenario), motion, model, start, words, points)


def _check_errors(scenario: Scenario) -> None:
    refused = {**NO_CLOCKS, "platform": "truth.sigma_navigation_m says how well the observer is known"}
    if _axes(scenario) == 2:
        refused |= dict.fromkeys(("attitude_roll", "attitude_pitch"), "bearings in the plane turn about z only")
    refuse(scenario.truth.errors, "truth.errors", refused)


def _check_rows(name: str, options: EstimatorOptions, model: Bearing) -> None:
    unknown = [kind for kind in options.measurements if kind not in model.names]
    if unknown or (options.measurements and len(options.measurements) < model.size):
        raise UserError(
            f"estimators.{name}.measurements: {options.measurements} is not allowed; {', '.join(model.names)}, or empty"
        )


def _azimuth_filter(scenario: Scenario, bus: Bus, estimator: str, name: str, clock: Clock) -> AzimuthFilter:
    """Return the azimuth filter of that name; one block serves all locators that use it."""
    signal = f"{name}.bearing"
    if signal in bus:
        return cast(AzimuthFilter, bus[signal].get_system())
    choose(f"estimators.{estimator}.bearings", name, ["raw", *scenario.azimuth_filters])
    if name in scenario.estimators:
        raise UserError(f"azimuth_filters.{name}: there is an estimator of that name; another is needed")
    if _axes(scenario) == 3:
        raise UserError(f"estimators.{estimator}.bearings: {name} is not allowed where elevation is measured; raw")
    model = believed_sensor(scenario)
    wiring = Wiring(bus.trials, model.names, clock, 1, bus.shape("known")[0])
    block = scenario.azimuth_filters[name].make(name, model.sigma, wiring)
    return bus.add(block, takes={"platforms": "known"})


SYSTEM = System(
    name="bearing_crossing",
    title="one aircraft, bearings only: azimuth filtered in pieces, crossing of lines, direct filters",
    scenario=Scenario,
    declare=declare,
    **packaged("bearing_crossing"),
)
