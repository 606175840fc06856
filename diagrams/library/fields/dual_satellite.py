"""The scenario of `dual_satellite`: the truth, and what the estimators believe."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.parts.biases import BIASES, BelievedBias
from quietfix.diagrams.parts.dual_signal import Drawn, Signal
from quietfix.diagrams.parts.formation import (
    EarthConstants,
    GreatCircle,
    Kepler,
    Offset,
    PositionVelocity,
    RandomAcceleration,
    ReferenceOrbit,
    StraightLine,
)
from quietfix.diagrams.parts.latency import LateBelief, LatencyOptions
from quietfix.diagrams.parts.sensor_errors import SensorErrors
from quietfix.systems.documented import choice, documented, number
from quietfix.systems.options.choice import EstimatorChoice

__all__ = ["PLATFORMS", "Scenario", "Truth"]

PLATFORMS = ("main", "auxiliary")
"""Names of the satellites, in their order in the scenario."""


@dataclass
class Truth:
    """The truth."""

    latitude_deg: float = number("geodetic latitude of the target at t = 0 [deg]", 4.0, at_least=-90, at_most=90)
    longitude_deg: float = number("longitude of the target at t = 0 [deg]", 5.0, at_least=-360, at_most=360)
    height_km: float = number("height of the target above the ellipsoid [km]", 10.0, above=-1, at_most=500)
    speed_mps: float = number("speed of the target [m/s]", 300.0, at_least=0, at_most=8000)
    course_deg: float = number("course of the target, clockwise from north [deg]", 60.0)
    motion: StraightLine | GreatCircle | RandomAcceleration = documented(
        "how the target moves: !StraightLine, !GreatCircle or !RandomAcceleration", factory=StraightLine
    )
    carrier_ghz: float = number("carrier frequency of the emitter [GHz]", 3.0, above=0)
    direction: str = choice(
        "angles: azimuth and depression at the main satellite; cosines: direction cosines, for above 85 deg depression",
        "angles",
        ("angles", "cosines"),
    )
    sigma_direction_deg: float = number("standard deviation of each angle of the direction [deg]", 0.5, above=0)
    differences: str = choice(
        "errors of TDOA and FDOA. stated: the two standard deviations below; stein: those that signal-to-noise ratio, "
        "bandwidth and integration time leave",
        "stated",
        ("stated", "stein"),
    )
    sigma_tdoa_ns: float = number("stated standard deviation of the TDOA [ns]", 20.0, above=0)
    sigma_fdoa_hz: float = number("stated standard deviation of the FDOA [Hz]", 1.0, above=0)
    snr_main_db: float = number("stein: signal-to-noise ratio in the noise bandwidth, main satellite [dB]", -13.0)
    snr_auxiliary_db: float = number("stein: the same at the auxiliary satellite [dB]", -13.0)
    noise_bandwidth_mhz: float = number("stein: noise bandwidth of both receivers [MHz]", 2.5, above=0)
    rms_bandwidth_mhz: float = number(
        "stein: rms width of the signal's spectrum about its centre [MHz]", 0.587, above=0
    )
    integration_ms: float = number("stein: integration time [ms]", 16.384, above=0)
    light_time: bool = documented("TDOA and FDOA of one wave front, instead of geometry of one instant", False)
    sigma_prior_position_km: float = number("error of the prior position per axis [km]", 5.0, above=0)
    sigma_assumed_height_km: float = number("error of the height that is assumed without a prior [km]", 3.0, above=0)
    minimum_elevation_deg: float = number(
        "a satellite lower than this over the target's horizon hears nothing [deg]", 0.0, at_least=-90, at_most=89
    )
    latency_s: LatencyOptions = documented("how late what is measured at an instant comes", factory=LatencyOptions)
    errors: SensorErrors = documented("errors of the sensors that the estimators do not know of", factory=SensorErrors)


@dataclass
class Belief:
    """What the estimators believe; null means: as the truth."""

    acceleration_mps2: float = number("process noise: acceleration in a step [m/s^2]", 0.1, at_least=0)
    sigma_velocity_mps: float = number("velocity at the start is 0 with this standard deviation [m/s]", 200.0, above=0)
    start: str = choice(
        "prior: from a prior position; measurement: from the first direction, TDOA and FDOA and an assumed height",
        "prior",
        ("prior", "measurement"),
    )
    sigma_prior_position_km: float | None = number("error of the prior position per axis [km]", None, above=0)
    sigma_assumed_height_km: float | None = number("error of the assumed height [km]", None, above=0)
    sigma_direction_deg: float | None = number("standard deviation of each angle of the direction [deg]", None, above=0)
    sigma_tdoa_ns: float | None = number("standard deviation of the TDOA [ns]", None, above=0)
    sigma_fdoa_hz: float | None = number("standard deviation of the FDOA [Hz]", None, above=0)
    light_time: bool | None = documented("TDOA and FDOA of one wave front", None)
    biases: dict[str, BelievedBias] = documented(BIASES, factory=dict)
    late: LateBelief = documented("what they make of measurements that come late", factory=LateBelief)


@dataclass
class Scenario:
    """Scenario of `dual_satellite`."""

    duration_s: float = number("length of the pass [s]", 150.0, above=0)
    period_s: float = number("time between measurements [s]", 1.0, above=0)
    divergence_m: float = number("a trial further off than this at the end has diverged [m]", 20e3, above=0)
    constants: EarthConstants = documented("physical constants", factory=EarthConstants)
    reference_orbit: ReferenceOrbit = documented("orbit that the offsets refer to", factory=ReferenceOrbit)
    satellites: list[Offset | Kepler | PositionVelocity] = documented(
        "the two satellites, !Offset, !Kepler or !PositionVelocity; the first is the main one and finds directions",
        factory=list,
    )
    truth: Truth = documented("the truth", factory=Truth)
    sensing: Drawn | Signal = documented(
        "!Drawn: TDOA and FDOA are drawn with the errors that truth states; !Signal: they come from I/Q samples",
        factory=Drawn,
    )
    belief: Belief = documented("what the estimators believe", factory=Belief)
    estimators: dict[str, EstimatorChoice] = documented("the estimators side by side", factory=dict)
