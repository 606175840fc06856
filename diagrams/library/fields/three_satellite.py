"""The scenario of `three_satellite`: the truth, and what the estimators believe."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.parts.biases import BIASES, BelievedBias
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

__all__ = ["PLATFORMS", "Scenario"]

PLATFORMS = ("satellite_0", "satellite_1", "satellite_2")
"""Names of the satellites, in their order in the scenario."""


@dataclass
class Truth:
    """The truth."""

    along_km: float = number("place of the target at t = 0, from satellite 0's sub-point at mid pass: along [km]", 0.0)
    cross_km: float = number("the same, to the right of the ground track [km]", 300.0)
    height_km: float = number("height of the target above the ellipsoid [km]", 10.0, above=-1, at_most=500)
    speed_mps: float = number("speed of the target [m/s]", 300.0, at_least=0, at_most=8000)
    course_deg: float = number("course of the target, clockwise from north [deg]", 60.0)
    motion: StraightLine | GreatCircle | RandomAcceleration = documented(
        "how the target moves: !StraightLine, !GreatCircle or !RandomAcceleration", factory=StraightLine
    )
    carrier_ghz: float = number("carrier frequency of the emitter [GHz]", 3.0, above=0)
    baseline_m: float = number("baseline of the interferometer on satellite 0 [m]", 3.0, above=0)
    chain_m: list[float] = documented(
        "shorter baselines that resolve the phase one after the other [m]; empty: the TDOA fix resolves it",
        factory=list,
    )
    phase: str = choice(
        "wrapped: the phases come in [-pi, pi); unambiguous: an ideal sensor",
        "wrapped",
        ("wrapped", "unambiguous"),
    )
    sigma_tdoa_ns: float = number("standard deviation of a TDOA [ns]", 20.0, above=0)
    sigma_fdoa_hz: float = number("standard deviation of an FDOA [Hz]", 1.0, above=0)
    sigma_phase_deg: float = number("standard deviation of a phase [deg]", 15.0, above=0)
    correlated: bool = documented("errors of differences correlated through satellite 0", False)
    light_time: bool = documented("TDOA and FDOA of one wave front, instead of geometry of one instant", False)
    paper_sign: bool = documented("FDOA as range-rate difference over wavelength, as the paper prints it", False)
    sigma_assumed_height_km: float = number("error of the height assumed at the start [km]", 3.0, above=0)
    minimum_elevation_deg: float = number(
        "a satellite lower than this over the target's horizon hears nothing [deg]",
        0.0,
        at_least=-90,
        at_most=89,
    )
    latency_s: LatencyOptions = documented("how late what is measured at an instant comes", factory=LatencyOptions)
    errors: SensorErrors = documented("errors of the sensors that the estimators do not know of", factory=SensorErrors)


@dataclass
class Belief:
    """What the estimators believe; null means: as the truth."""

    acceleration_mps2: float = number("process noise: acceleration in a step [m/s^2]", 0.1, at_least=0)
    sigma_velocity_mps: float = number("velocity at the start is 0 with this standard deviation [m/s]", 400.0, above=0)
    sigma_satellite_m: float = number("error of a satellite's position per axis, in P1 only [m]", 0.0, at_least=0)
    start: str = choice("how the first fix is solved", "auto", ("auto", "closed_form", "newton"))
    sigma_assumed_height_km: float | None = number("error of the assumed height [km]", None, above=0)
    sigma_tdoa_ns: float | None = number("standard deviation of a TDOA [ns]", None, above=0)
    sigma_fdoa_hz: float | None = number("standard deviation of an FDOA [Hz]", None, above=0)
    sigma_phase_deg: float | None = number("standard deviation of a phase [deg]", None, above=0)
    correlated: bool | None = documented("errors of differences correlated through satellite 0", None)
    light_time: bool | None = documented("TDOA and FDOA of one wave front", None)
    biases: dict[str, BelievedBias] = documented(BIASES, factory=dict)
    late: LateBelief = documented("what they make of measurements that come late", factory=LateBelief)


@dataclass
class Scenario:
    """Scenario of `three_satellite`."""

    duration_s: float = number("length of the pass [s]", 150.0, above=0)
    period_s: float = number("time between measurements [s]", 1.0, above=0)
    divergence_m: float = number("a trial further off than this at the end has diverged [m]", 50e3, above=0)
    constants: EarthConstants = documented("physical constants", factory=EarthConstants)
    reference_orbit: ReferenceOrbit = documented("orbit that the offsets refer to", factory=ReferenceOrbit)
    satellites: list[Offset | Kepler | PositionVelocity] = documented(
        "the three satellites, !Offset, !Kepler or !PositionVelocity; the first is the reference and carries the "
        "interferometer",
        factory=list,
    )
    truth: Truth = documented("the truth", factory=Truth)
    belief: Belief = documented("what the estimators believe", factory=Belief)
    estimators: dict[str, EstimatorChoice] = documented(
        "the estimators side by side; the first one's prediction resolves the phases", factory=dict
    )
