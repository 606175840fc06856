"""The scenario of `beacon_rocket`: the beacon's bias, the stations, and what the estimators believe."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.parts.biases import BIASES, BelievedBias
from quietfix.diagrams.parts.latency import LateBelief, LatencyOptions
from quietfix.diagrams.parts.launch import (
    Falcon9,
    Geodetic,
    Rocket,
    Site,
    SphericalEarth,
    Track,
)
from quietfix.diagrams.parts.sensor_errors import SensorErrors
from quietfix.systems.documented import choice, count, documented, number
from quietfix.systems.options.choice import EstimatorChoice

__all__ = ["Scenario", "StationSensing", "TransponderWindow"]


@dataclass
class ConstantBias:
    """The same at all times."""

    bias_mps: float = number("bias [m/s]", 220.0)


@dataclass
class LinearBias:
    """A line in the time since lift-off."""

    bias_mps: float = number("bias at lift-off [m/s]", 88.0)
    rate_mps2: float = number("its rate [m/s^2]", 0.1)


@dataclass
class PowerBias:
    """(level + eps) t^exponent + rate t, t since lift-off; eps normal."""

    level_mps: float = number("level [m/s]", 88.0)
    exponent: float = number("exponent of the time in seconds", 0.05, at_least=0)
    rate_mps2: float = number("rate [m/s^2]", 0.01)
    sigma_eps_mps: float = number("standard deviation of eps, the same at all stations [m/s]", 1.0, at_least=0)
    eps_per: str = choice("how often eps is drawn", "sample", ("sample", "run"))


@dataclass
class RandomWalkBias:
    """A random walk of the oscillator from lift-off on."""

    bias_mps: float = number("mean at lift-off [m/s]", 88.0)
    sigma_bias_mps: float = number("its standard deviation over the trials [m/s]", 10.0, at_least=0)
    density_m2ps3: float = number("variance gained per second [(m/s)^2/s]", 0.01, at_least=0)


@dataclass
class TransponderWindow:
    """When the transponder is locked."""

    begin_s: float = number("from [s]", 180.0)
    end_s: float = number("until [s]", 230.0)


@dataclass
class Mode:
    """Which of beacon and transponder is received."""

    transponder: list[TransponderWindow] = documented("when the transponder is locked; else the beacon", factory=list)
    uplink_station: int = count("station whose signal the transponder returns", 0, at_least=0)
    late_stations: list[int] = documented("stations that switch later than the others", factory=list)
    late_samples: int = count("how many samples later", 1)


@dataclass
class StationSensing:
    """What the stations measure."""

    sigma_mps: float = number("standard deviation of a range rate [m/s]", 0.03, above=0)
    sigma_station_residual_mps: float = number(
        "each station's own constant part of the beacon's bias [m/s]", 0.0, at_least=0
    )
    minimum_elevation_deg: float | None = number(
        "a station sees the rocket above this elevation [deg]; null: always, even through the Earth", None,
        at_least=-90, at_most=89,
    )  # fmt: skip
    latency_s: LatencyOptions = documented("how late a range rate comes, by station", factory=LatencyOptions)
    errors: SensorErrors = documented("errors that the estimators do not know of", factory=SensorErrors)


@dataclass
class Initial:
    """Error of the start."""

    position_m: float = number("error of the position on every axis [m]", 50.0)
    velocity_mps: float = number("error of the velocity on every axis [m/s]", 1.0)
    random_signs: bool = documented("draw the signs of the errors per trial", False)


@dataclass
class Belief:
    """What the estimators believe; null means: as the truth."""

    alpha_hz: float = number("manoeuvre frequency of the current statistical model [1/s]", 0.01, above=0)
    mean_acceleration: str = choice(
        "mean acceleration: the estimate, or filtered by the paper's eq. (9)", "estimate", ("estimate", "filtered")
    )
    a_max_mps2: list[float] | None = documented("largest acceleration per axis; null: of the flight [m/s^2]", None)
    a_min_mps2: list[float] | None = documented("smallest acceleration per axis; null: of the flight [m/s^2]", None)
    limit_margin: float = number("factor on the limits of the flight", 1.0, above=0)
    sigma_floor_mps2: float = number("least sigma of the acceleration [m/s^2]", 1.0, at_least=0)
    bias_variance_per_step_m2ps2: float = number("process noise of the bias per period [(m/s)^2]", 1.0, at_least=0)
    sigma_position_m: float = number("start [m]", 50.0, above=0)
    sigma_velocity_mps: float = number("start [m/s]", 1.0, above=0)
    sigma_acceleration_mps2: float = number("start [m/s^2]", 5.0, above=0)
    sigma_bias_mps: float = number("start [m/s]; the bias starts at 0", 300.0, above=0)
    sigma_mps: float | None = number("standard deviation of a range rate [m/s]", None, above=0)
    biases: dict[str, BelievedBias] = documented(BIASES, factory=dict)
    late: LateBelief = documented("what they make of measurements that come late", factory=LateBelief)


@dataclass
class Scenario:
    """Scenario of `beacon_rocket`."""

    start_s: float = number("tracking begins this long after lift-off [s]", 50.0, at_least=0)
    stop_s: float = number("tracking ends [s]", 300.0, above=0)
    period_s: float = number("time between samples [s]", 0.05, above=0)
    divergence_m: float = number("a trial further off than this at the end has diverged [m]", 1e3, above=0)
    constants: SphericalEarth = documented("physical constants", factory=SphericalEarth)
    site: Site = documented("launch site: origin and axes of the launch frame", factory=Site)
    vehicle: Rocket | Falcon9 = documented("what flies, !Rocket or !Falcon9", factory=Rocket)
    stations: list[Track | Geodetic] = documented("stations, !Track or !Geodetic", factory=list)
    bias: ConstantBias | LinearBias | PowerBias | RandomWalkBias = documented(
        "the beacon's bias, !ConstantBias, !LinearBias, !PowerBias or !RandomWalkBias", factory=ConstantBias
    )
    mode: Mode = documented("beacon or transponder", factory=Mode)
    sensor: StationSensing = documented("what the stations measure", factory=StationSensing)
    initial: Initial = documented("error of the start", factory=Initial)
    belief: Belief = documented("what the estimators believe", factory=Belief)
    estimators: dict[str, EstimatorChoice] = documented("the estimators side by side", factory=dict)
