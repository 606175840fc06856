"""The scenario of `bearing_crossing`: path, target, errors, and what the estimators believe."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.parts.biases import BIASES, BelievedBias
from quietfix.diagrams.parts.latency import LateBelief, LatencyOptions
from quietfix.diagrams.parts.sensor_errors import SensorErrors
from quietfix.systems.documented import choice, documented, number
from quietfix.systems.estimators.azimuth_filter import AzimuthFilterOptions
from quietfix.systems.options.choice import EstimatorChoice

__all__ = ["Scenario"]


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
    """The truth."""

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
    latency_s: LatencyOptions = documented("how late a bearing comes", factory=LatencyOptions)
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
    biases: dict[str, BelievedBias] = documented(BIASES, factory=dict)
    late: LateBelief = documented("what they make of bearings that come late", factory=LateBelief)


@dataclass
class Scenario:
    """Scenario of `bearing_crossing`."""

    duration_s: float = number("length of the run [s]", 1000.0, above=0)
    period_s: float = number("time between bearings [s]", 1.0, above=0)
    divergence_m: float = number("a trial further off than this at the end has diverged [m]", 20e3, above=0)
    truth: Truth = documented("the truth", factory=Truth)
    belief: Belief = documented("what the estimators believe", factory=Belief)
    azimuth_filters: dict[str, AzimuthFilterOptions] = documented(
        "linear Kalman filters of the azimuth, by name; a crossing locator's `bearings` says which one it uses",
        factory=dict,
    )
    estimators: dict[str, EstimatorChoice] = documented("the estimators side by side", factory=dict)
