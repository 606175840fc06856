"""A three-stage rocket seen as range rates whose beacon drifts: one bias shared by all stations.

Shang, Xing and Gan, *Real-time processing of tracking data of maneuvering target in beacon-mode*, Control Theory &
Applications 29 (2012) 59. Everything is in the launch frame: Earth-fixed axes at the launch site of a spherical Earth,
X down-range, Y up. State of truth and estimates: position, velocity, acceleration, bias (the paper interleaves the
axes).
"""

# No `from __future__ import annotations` here: Drake's YAML loader needs the types themselves.
import math
import warnings
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Union, cast

import numpy as np
from numpy.typing import NDArray

from diagrams.assembly.bus import Bus
from diagrams.assembly.map import BoundMap
from diagrams.assembly.model import Assumed, Model
from diagrams.assembly.system import System, packaged
from diagrams.errors import UserError
from diagrams.launch import (
    Constants,
    Falcon9,
    Geodetic,
    Rocket,
    Site,
    Track,
    launch_site,
    rocket_model,
    station_names,
    station_positions,
    vehicle_block,
)
from diagrams.maps.flight import flight_map
from diagrams.parts.impairment import Impaired, KnownPlatforms
from diagrams.sensor_errors import NO_CLOCKS, SensorErrors, refuse
from systems.clocks import Periodic
from systems.documented import choice, count, documented, number
from systems.estimators.options import EstimatorOptions
from systems.estimators.start import PortStart
from systems.measurement.geometry import line_of_sight
from systems.measurement.range_rate import RangeRate
from systems.measurement.visibility import SphericalMask
from systems.motion.current_statistical import CurrentStatistical, MeanAcceleration
from systems.motion.known_flight import KnownFlight
from systems.motion.random_walk import RandomWalk as RandomWalkMotion
from systems.plants.joined import Joined
from systems.plants.mode_schedule import ModeSchedule
from systems.plants.model_plant import ModelPlant
from systems.plants.oscillator import BiasLaw, OscillatorBias
from systems.plants.recorded_flight import RecordedFlight
from systems.plants.rocket import Rocket as RocketPlant
from systems.registry import estimator_options
from systems.sensors.beacon import BeaconStations
from systems.sensors.offset_prior import OffsetPrior
from systems.signals import Constant, EnsembleBlock

__all__ = [
    "SYSTEM",
    "Scenario",
    "believed_motion",
    "believed_sensor",
    "bound_map",
    "launch_site",
    "rocket_model",
    "sensor_mask",
    "station_positions",
]

Array = NDArray[np.float64]

if TYPE_CHECKING:
    EstimatorChoice = EstimatorOptions
else:
    EstimatorChoice = Union[estimator_options()]  # noqa: UP007 - the members come from the registry

_FLOWN = 400  # points of the flight on a map
_UNKNOWNS = ("x", "y", "z", "vx", "vy", "vz", "bias")  # of one sample


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
class Window:
    """When the transponder is locked."""

    begin_s: float = number("from [s]", 180.0)
    end_s: float = number("until [s]", 230.0)


@dataclass
class Mode:
    """Which of beacon and transponder is received."""

    transponder: list[Window] = documented("when the transponder is locked; else the beacon", factory=list)
    uplink_station: int = count("station whose signal the transponder returns", 0, at_least=0)
    late_stations: list[int] = documented("stations that switch later than the others", factory=list)
    late_samples: int = count("how many samples later", 1)


@dataclass
class Sensor:
    """What the stations measure."""

    sigma_mps: float = number("standard deviation of a range rate [m/s]", 0.03, above=0)
    sigma_station_residual_mps: float = number(
        "each station's own constant part of the beacon's bias [m/s]", 0.0, at_least=0
    )
    minimum_elevation_deg: float | None = number(
        "a station sees the rocket above this elevation [deg]; null: always, even through the Earth", None,
        at_least=-90, at_most=89,
    )  # fmt: skip
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


@dataclass
class Scenario:
    """Scenario of `beacon_rocket`."""

    start_s: float = number("tracking begins this long after lift-off [s]", 50.0, at_least=0)
    stop_s: float = number("tracking ends [s]", 300.0, above=0)
    period_s: float = number("time between samples [s]", 0.05, above=0)
    divergence_m: float = number("a trial further off than this at the end has diverged [m]", 1e3, above=0)
    constants: Constants = documented("physical constants", factory=Constants)
    site: Site = documented("launch site: origin and axes of the launch frame", factory=Site)
    vehicle: Rocket | Falcon9 = documented("what flies, !Rocket or !Falcon9", factory=Rocket)
    stations: list[Track | Geodetic] = documented("stations, !Track or !Geodetic", factory=list)
    bias: ConstantBias | LinearBias | PowerBias | RandomWalkBias = documented(
        "the beacon's bias, !ConstantBias, !LinearBias, !PowerBias or !RandomWalkBias", factory=ConstantBias
    )
    mode: Mode = documented("beacon or transponder", factory=Mode)
    sensor: Sensor = documented("what the stations measure", factory=Sensor)
    initial: Initial = documented("error of the start", factory=Initial)
    belief: Belief = documented("what the estimators believe", factory=Belief)
    estimators: dict[str, EstimatorChoice] = documented("the estimators side by side", factory=dict)


def _limits(scenario: Scenario, plant: Any) -> tuple[Array, Array]:
    """Return the largest and smallest acceleration per axis that the estimators believe in."""
    belief = scenario.belief
    for name in ("a_max_mps2", "a_min_mps2"):
        value = getattr(belief, name)
        if value is not None and len(value) != 3:
            raise UserError(f"belief.{name}: {value} is not allowed; a list of three numbers, along x, y and z")
    times = np.arange(scenario.start_s, scenario.stop_s, scenario.period_s)
    flown = np.array([plant.at(float(t))[1] for t in times])
    largest = np.maximum(flown.max(axis=0), 0.0) * belief.limit_margin
    smallest = np.minimum(flown.min(axis=0), 0.0) * belief.limit_margin
    return (
        largest if belief.a_max_mps2 is None else np.array(belief.a_max_mps2),
        smallest if belief.a_min_mps2 is None else np.array(belief.a_min_mps2),
    )


def _warn_unobservable(positions: Array, plant: Any, scenario: Scenario) -> None:
    """Say what too few stations leave open in one sample."""
    if len(positions) >= len(_UNKNOWNS):
        return
    state = plant.at(0.5 * (scenario.start_s + scenario.stop_s))[0]
    still = np.concatenate([positions, np.zeros_like(positions)], axis=-1)
    sight = line_of_sight(state, still)
    # Lengths are scaled by the mean range over the speed, so that all columns are per m/s.
    scale = sight.distance.mean() / np.linalg.norm(state[3:])
    rows = np.concatenate([sight.range_rate_gradient * scale, sight.direction, np.ones((len(positions), 1))], axis=-1)
    free = np.linalg.svd(rows)[2][len(positions) :]
    share = np.einsum("ki,ki->i", free, free)
    named = [_UNKNOWNS[i] for i in np.argsort(-share) if share[i] > 0.5] or [_UNKNOWNS[int(np.argmax(share))]]
    warnings.warn(
        f"stations: {len(positions)} for the {len(_UNKNOWNS)} unknowns of a sample ({', '.join(_UNKNOWNS)}); "
        f"{len(free)} combinations are unobservable but through the motion, mostly {', '.join(named)}",
        stacklevel=2,
    )


# ----------------------------------------------------------------------------------------------------- declared


def _oscillator(scenario: Scenario, clock: Periodic, trials: int) -> EnsembleBlock:
    bias = scenario.bias
    if isinstance(bias, RandomWalkBias):
        walk = RandomWalkMotion([bias.density_m2ps3], ["bias"], ["m/s"])
        return ModelPlant(walk, clock, [bias.bias_mps], [[bias.sigma_bias_mps**2]], trials, name="oscillator")
    if isinstance(bias, ConstantBias):
        law = BiasLaw(bias.bias_mps)
    elif isinstance(bias, LinearBias):
        law = BiasLaw(bias.bias_mps, rate=bias.rate_mps2)
    else:
        per: Any = bias.eps_per
        law = BiasLaw(bias.level_mps, bias.exponent, bias.rate_mps2, bias.sigma_eps_mps, per)
    return OscillatorBias(law, clock, trials)


def _mode_block(scenario: Scenario) -> ModeSchedule:
    mode, names = scenario.mode, station_names(scenario)
    stations = len(names)
    for name, asked in (("late_stations", mode.late_stations), ("uplink_station", [mode.uplink_station])):
        outside = [i for i in asked if not 0 <= i < stations]
        if outside:
            raise UserError(f"mode.{name}: {outside[0]} is not allowed; a station, 0 to {stations - 1}")
    delays = np.zeros(stations)
    delays[mode.late_stations] = mode.late_samples * scenario.period_s
    return ModeSchedule([(w.begin_s, w.end_s) for w in mode.transponder], delays, names)


def _believed_motion(scenario: Scenario, limits: tuple[Array, Array], biased: bool = True) -> CurrentStatistical:
    belief = scenario.belief
    density = belief.bias_variance_per_step_m2ps2 / scenario.period_s
    return CurrentStatistical(
        belief.alpha_hz,
        *limits,
        belief.sigma_floor_mps2,
        [density] if biased else [],
        cast(MeanAcceleration, belief.mean_acceleration),
    )


def believed_motion(scenario: Scenario, vehicle: Any) -> CurrentStatistical:
    """Return how the estimators believe that the vehicle moves, a block of `diagrams.launch.vehicle_block`."""
    return _believed_motion(scenario, _limits(scenario, vehicle))


def _believed_sigma(scenario: Scenario) -> float:
    return scenario.sensor.sigma_mps if scenario.belief.sigma_mps is None else scenario.belief.sigma_mps


def believed_sensor(scenario: Scenario) -> RangeRate:
    """Return the sensor as the estimators believe it to be, with the bias as the tenth state."""
    return RangeRate(_believed_sigma(scenario), range(len(scenario.stations)), 9)


def sensor_mask(scenario: Scenario) -> SphericalMask | None:
    """Return what hides the rocket from a station; None: nothing, not even the Earth."""
    minimum = scenario.sensor.minimum_elevation_deg
    if minimum is None:
        return None
    return SphericalMask(math.radians(minimum), "platform", tuple(launch_site(scenario).centre))


def _truth_motion(scenario: Scenario) -> KnownFlight | None:
    """Return the motion that the bounds may believe in: the flown acceleration known, the bias's law too.

    None where the bias is none of a state's: redrawn at every sample, growing with a power of time, or jumping to the
    transponder's range rate and back.
    """
    if any(w.end_s > scenario.start_s and w.begin_s < scenario.stop_s for w in scenario.mode.transponder):
        return None
    if isinstance(scenario.bias, RandomWalkBias):
        return KnownFlight([scenario.bias.density_m2ps3])
    return KnownFlight([0.0]) if isinstance(scenario.bias, ConstantBias | LinearBias) else None


def _start_covariance(belief: Belief, biased: bool) -> Array:
    sigmas = [belief.sigma_position_m] * 3 + [belief.sigma_velocity_mps] * 3 + [belief.sigma_acceleration_mps2] * 3
    return np.diag(np.square([*sigmas, belief.sigma_bias_mps] if biased else sigmas))


@dataclass(frozen=True)
class _Flight:
    """Rocket, oscillator and stations: publishes ``target``, ``platforms``, ``measured`` and ``truth``.

    The truth is the rocket's state and acceleration, and the bias that all stations share.
    """

    scenario: Scenario
    clock: Periodic
    vehicle: RocketPlant | RecordedFlight
    positions: Array
    sensor: RangeRate

    def __call__(self, bus: Bus) -> None:
        """See `diagrams.assembly.model.Part`."""
        scenario, count_ = self.scenario, len(self.positions)
        vehicle = bus.add(self.vehicle.again(), gives={"target": "state"})
        bus.publish(stage=vehicle.GetOutputPort("stage"), acceleration=vehicle.GetOutputPort("acceleration"))
        still = np.concatenate([self.positions, np.zeros_like(self.positions)], axis=1)
        bus.add(Constant("sites", still.ravel()), gives={"platforms": "state"})
        bus.add(_oscillator(scenario, self.clock, bus.trials), gives={"bias": "state"})
        bus.add(_mode_block(scenario), gives={"mode": "mode"})
        stations = BeaconStations(
            self.sensor,
            self.clock,
            bus.trials,
            count_,
            target_trials=bus.shape("target")[0],
            bias_trials=bus.shape("bias")[0],
            uplink=scenario.mode.uplink_station,
            sigma_residual=scenario.sensor.sigma_station_residual_mps,
            mask=sensor_mask(scenario),
        )
        bus.add(stations, gives={"measured": "measurement", "common": "common"})
        parts = ("target", "acceleration", "common")
        bus.add(Joined({signal: bus.shape(signal) for signal in parts}), gives={"truth": "state"})


@dataclass(frozen=True)
class _Prior:
    """Publishes ``initial_estimate_10`` and ``initial_estimate_9``, off by what the scenario says."""

    scenario: Scenario

    def __call__(self, bus: Bus) -> None:
        """See `diagrams.assembly.model.Part`."""
        initial, trials = self.scenario.initial, bus.shape("truth")[0]
        offsets = [initial.position_m] * 3 + [initial.velocity_mps] * 3 + [0.0] * 4
        signs, sizes = [True] * 9 + [False], (10, 9)
        prior = OffsetPrior(
            offsets, signs, sizes, self.scenario.start_s, bus.trials, trials, random_signs=initial.random_signs
        )
        bus.add(prior, gives={f"initial_estimate_{size}": f"initial_estimate_{size}" for size in sizes})


def declare(scenario: Scenario) -> Model:
    """Return rocket, oscillator, stations, prior and what the estimators are given; see `diagrams.assembly`."""
    if scenario.stop_s < scenario.start_s + scenario.period_s:
        raise UserError(f"stop_s: {scenario.stop_s:g} is not allowed; it must be after start_s {scenario.start_s:g}")
    clock, positions = Periodic(scenario.period_s, scenario.start_s), station_positions(scenario)
    vehicle, errors = vehicle_block(scenario), scenario.sensor.errors
    _warn_unobservable(positions, vehicle, scenario)
    refuse(errors, "sensor.errors", {**NO_CLOCKS, "attitude": "range rates know no directions"})
    limits, stations = _limits(scenario, vehicle), range(len(positions))
    real, sigma = RangeRate(scenario.sensor.sigma_mps, stations), _believed_sigma(scenario)

    def assume(bus: Bus, name: str, options: EstimatorOptions) -> Assumed:
        if options.measurements not in ([], ["range_rate"]):
            raise UserError(f"estimators.{name}.measurements: {options.measurements} is not allowed; range_rate")
        biased = getattr(options, "estimates_bias", True)
        motion = _believed_motion(scenario, limits, biased)
        model = RangeRate(sigma, stations, 9 if biased else None)
        start = PortStart(_start_covariance(scenario.belief, biased))
        return Assumed(model, motion, start, real.names, {"initial_estimate": f"initial_estimate_{motion.size}"})

    return Model(
        clock=clock,
        duration=scenario.stop_s,
        divergence=scenario.divergence_m,
        parts=[
            _Flight(scenario, clock, vehicle, positions, real),
            Impaired(real, clock, errors),
            KnownPlatforms(errors.sigma_platform_position_m, errors.sigma_platform_velocity_mps),
            _Prior(scenario),
        ],
        assume=assume,
        truth_motion=_truth_motion(scenario),
        truth_states=KnownFlight([0.0]).names,
        signals={"mode": "mode", "stage": "stage"},
        platforms=station_names(scenario),
        frame="launch",
        map=partial(bound_map, scenario),
    )


def bound_map(scenario: Scenario, points: tuple[int, int] | None = None) -> BoundMap:
    """Return the map of the bound in the plane of the flight; see `flight_map`."""
    vehicle, belief = vehicle_block(scenario), scenario.belief
    flown_at = np.linspace(scenario.start_s, scenario.stop_s, _FLOWN)
    return flight_map(
        np.array([np.concatenate(vehicle.at(float(t))) for t in flown_at]),
        launch_site(scenario),
        station_positions(scenario),
        Periodic(scenario.period_s),
        believed_sensor(scenario),
        believed_motion(scenario, vehicle),
        sensor_mask(scenario),
        belief.sigma_acceleration_mps2,
        belief.sigma_bias_mps,
        f"current statistical model, {belief.alpha_hz:g} 1/s",
        points,
    )


SYSTEM = System(
    name="beacon_rocket",
    title="three-stage rocket, range rates at many stations, the beacon's drift as one shared bias",
    scenario=Scenario,
    declare=declare,
    **packaged("beacon_rocket"),
)
