"""A system of a user's own: its schema, and what its file declares."""

# No `from __future__ import annotations` here: Drake's YAML loader needs the types themselves.
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, Union, cast

import numpy as np
from numpy.typing import NDArray

from diagrams.assembly.bus import Bus
from diagrams.assembly.model import Assumed, Model, Part
from diagrams.assembly.system import System
from diagrams.errors import UserError, choose
from diagrams.formation import Constants, gravity_constants
from diagrams.own.movers import (
    Fixed,
    Geodetic,
    GreatCircle,
    Kepler,
    PositionVelocity,
    RandomMotion,
    Straight,
    Waypoints,
)
from diagrams.own.paths import Path, path_of
from diagrams.own.sensors import Altitude, Bearing, Fdoa, Places, Range, RangeRate, Sensor, Tdoa
from diagrams.parts.impairment import Impaired, KnownPlatforms, Mount
from diagrams.parts.movers import ModelTarget, Platforms
from diagrams.parts.sensing import TargetSensor
from diagrams.sensor_errors import refuse
from systems.clocks import Clock, Merged, Periodic
from systems.documented import choice, documented, number
from systems.estimators.options import EstimatorOptions
from systems.estimators.start import GivenStart, PortStart, Start
from systems.measurement.base import MeasurementModel
from systems.measurement.bearing import Bearing as BearingModel
from systems.measurement.differenced import Differenced
from systems.measurement.stack import Stack
from systems.measurement.visibility import ElevationMask
from systems.motion import constant_velocity
from systems.motion.base import MotionModel
from systems.motion.orbital import OrbitalMotion
from systems.plants.joined import Joined
from systems.plants.path import Path as PathBlock
from systems.registry import estimator_options
from systems.sensors.prior import PriorEstimate

__all__ = ["OwnScenario", "declare", "own_system"]

Array = NDArray[np.float64]

if TYPE_CHECKING:
    EstimatorChoice = EstimatorOptions
else:
    EstimatorChoice = Union[estimator_options()]  # noqa: UP007 - the members come from the registry

_STATES = ("x", "y", "z", "vx", "vy", "vz")


@dataclass
class WhiteNoiseAcceleration:
    """Straight on, driven by white acceleration noise in continuous time: fit for any mixture of rates."""

    density_m2ps3: float = number("power spectral density of the acceleration per axis [m^2/s^3]", 0.1, at_least=0)


@dataclass
class ConstantVelocity:
    """Straight on, with an acceleration drawn anew in every step: two steps of 1 s have less noise than one of 2 s."""

    acceleration_mps2: float = number("standard deviation of the acceleration in a step [m/s^2]", 0.1, at_least=0)


@dataclass
class Orbital:
    """Falls around the Earth, driven by white acceleration noise; of inertial states."""

    density_m2ps3: float = number("power spectral density of the acceleration per axis [m^2/s^3]", 0.0, at_least=0)


@dataclass
class Belief:
    """What the estimators believe."""

    motion: WhiteNoiseAcceleration | ConstantVelocity | Orbital = documented(
        "how the target moves", factory=WhiteNoiseAcceleration
    )
    sensors: dict[str, Tdoa | Fdoa | Range | RangeRate | Bearing | Altitude] = documented(
        "sensors that are believed to be otherwise than they are, by name and in full", factory=dict
    )


@dataclass
class Prior:
    """An estimate before the first measurement, off by what it says of itself; drawn about the truth in every trial."""

    sigma_position_m: float = number("standard deviation of the position per axis [m]", 1000.0, above=0)
    sigma_velocity_mps: float = number("standard deviation of the velocity per axis [m/s]", 50.0, above=0)


@dataclass
class Given:
    """The same estimate in every trial."""

    at: Fixed | Geodetic | Straight | Waypoints | GreatCircle | Kepler | PositionVelocity = documented(
        "where it says that the target is at t = 0", factory=Fixed
    )
    sigma_position_m: float = number("standard deviation of the position per axis [m]", 1000.0, above=0)
    sigma_velocity_mps: float = number("standard deviation of the velocity per axis [m/s]", 50.0, above=0)


@dataclass
class PlatformErrors:
    """How well the estimators know the platforms."""

    sigma_position_m: float = number("error per axis, constant, drawn per trial [m]", 0.0, at_least=0)
    sigma_velocity_mps: float = number("the same of the velocity [m/s]", 0.0, at_least=0)


@dataclass
class OwnScenario:
    """A system of a user's own."""

    frame: str = choice(
        "axes of all states. local: east, north, up on a flat Earth; earth_fixed; inertial",
        "local",
        ("local", "earth_fixed", "inertial"),
    )
    duration_s: float = number("length of a run [s]", 100.0, above=0)
    divergence_m: float = number("a trial further off than this at the end has diverged [m]", 50e3, above=0)
    constants: Constants = documented("physical constants", factory=Constants)
    platforms: dict[str, Fixed | Geodetic | Straight | Waypoints | GreatCircle | Kepler | PositionVelocity] = (
        documented("what carries the sensors, by name", factory=dict)
    )
    platform_errors: PlatformErrors = documented("how well the platforms are known", factory=PlatformErrors)
    target: Fixed | Geodetic | Straight | Waypoints | GreatCircle | Kepler | PositionVelocity | RandomMotion = (
        documented("what is looked for", factory=Fixed)
    )
    sensors: dict[str, Tdoa | Fdoa | Range | RangeRate | Bearing | Altitude] = documented(
        "what is measured, by name", factory=dict
    )
    belief: Belief = documented("what the estimators believe", factory=Belief)
    start: Prior | Given = documented("how the estimators begin", factory=Prior)
    estimators: dict[str, EstimatorChoice] = documented("the estimators side by side", factory=dict)

    @property
    def period_s(self) -> float:
        """Time between the measurements of the fastest sensor [s]."""
        return min((sensor.every_s for sensor in self.sensors.values()), default=1.0)


# ------------------------------------------------------------------------------------------------- sensors


@dataclass(frozen=True)
class _Placed:
    """A sensor with its name, as it is and as it is believed to be."""

    name: str
    field: Sensor
    real: MeasurementModel
    believed: MeasurementModel

    @property
    def clock(self) -> Periodic:
        return Periodic(self.field.every_s, self.field.offset_s)

    @property
    def mask(self) -> ElevationMask | None:
        elevation = self.field.minimum_elevation_deg
        return None if elevation is None else ElevationMask(math.radians(elevation), cast(Any, self.field.elevation_at))


def _placed(scenario: OwnScenario, places: Places) -> list[_Placed]:
    """Return the sensors of a scenario, checked."""
    if not scenario.sensors:
        raise UserError("sensors: none is given; at least one is needed")
    for name in scenario.belief.sensors:
        choose("belief.sensors", name, scenario.sensors)
    found = []
    for name, field in scenario.sensors.items():
        where = f"sensors.{name}"
        if field.minimum_elevation_deg is not None and scenario.frame != "earth_fixed":
            raise UserError(
                f"{where}.minimum_elevation_deg: it is for frame earth_fixed only, this is {scenario.frame}"
            )
        if field.offset_s > scenario.duration_s:
            raise UserError(f"{where}.offset_s: {field.offset_s:g} is not allowed; at most duration_s")
        if name in scenario.estimators or name in ("truth", "target", "platforms", "measurements", "prior"):
            raise UserError(f"{where}: the name {name} is not allowed; another block of the diagram has it")
        real = _model(field, places, where)
        other = scenario.belief.sensors.get(name)
        believed = real if other is None else _model(other, places, f"belief.sensors.{name}")
        if list(believed.names) != list(real.names):
            raise UserError(
                f"belief.sensors.{name}: rows {list(believed.names)} are not allowed; the sensor has {list(real.names)}"
            )
        found.append(_Placed(name, field, real, believed))
    return found


def _model(field: Sensor, places: Places, where: str) -> MeasurementModel:
    try:
        return field.model(places, where)
    except UserError:
        raise
    except ValueError as error:
        raise UserError(f"{where}: {error}") from error


def _impaired(one: _Placed, frame: str) -> Impaired:
    where, model = f"sensors.{one.name}.errors", one.real
    refused = {"platform": "platform_errors says how well the platforms are known"}
    mounts, clocks = [], {}
    if isinstance(one.field, Bearing) and isinstance(model, BearingModel) and frame == "local":
        mounts = [Mount(model.names, model.platform)]
    else:
        refused["attitude"] = "only a !Bearing in local axes has a direction that it may be off in"
    if isinstance(one.field, Tdoa) and isinstance(model, Differenced):
        pairs = zip(model.names, model.receivers, strict=True)
        clocks = {row: (receiver, model.reference) for row, receiver in pairs}
    else:
        refused["clock_offset"] = "only a !Tdoa compares clocks"
    refuse(one.field.errors, where, refused)
    raw = f"{one.name}_raw"
    return Impaired(
        model, one.clock, one.field.errors, mounts, clocks, takes=one.name, gives=[raw], prefix=f"{one.name}_"
    )


@dataclass(frozen=True)
class _Together:
    """All sensors' rows side by side; a sensor off its own clock has none. Publishes ``measurement``."""

    names: Sequence[str]

    def __call__(self, bus: Bus) -> None:
        """See `diagrams.assembly.model.Part`."""
        raw = {name: f"{name}_raw" for name in self.names}
        if len(raw) == 1:
            bus.publish(measurement=bus[next(iter(raw.values()))])
            return
        shapes = {name: bus.shape(signal) for name, signal in raw.items()}
        bus.add(Joined(shapes, "measurements"), gives={"measurement": "state"}, takes=raw)


# ------------------------------------------------------------------------------------------------ declared


def _motion(scenario: OwnScenario) -> MotionModel:
    field = scenario.belief.motion
    if isinstance(field, Orbital):
        if scenario.frame != "inertial":
            raise UserError(f"belief.motion: !Orbital is for frame inertial only, this is {scenario.frame}")
        constants = gravity_constants(scenario.constants)
        return OrbitalMotion(constants, constants.j2 != 0, density=field.density_m2ps3)
    if isinstance(field, ConstantVelocity):
        return constant_velocity.ConstantVelocity(field.acceleration_mps2)
    return constant_velocity.WhiteNoiseAcceleration(field.density_m2ps3)


def _true_motion(scenario: OwnScenario, believed: MotionModel) -> MotionModel | None:
    """Return the motion that the target really has, if it is one of the models."""
    target = scenario.target
    if isinstance(target, RandomMotion):
        return believed
    if isinstance(target, Kepler | PositionVelocity) and scenario.frame == "inertial":
        constants = gravity_constants(scenario.constants)
        return OrbitalMotion(constants, constants.j2 != 0)
    if isinstance(target, Fixed | Straight) or (isinstance(target, Geodetic) and scenario.frame == "earth_fixed"):
        return constant_velocity.ConstantVelocity(0.0)
    return None


def _spread(position: float, velocity: float) -> Array:
    return np.diag(np.square([position] * 3 + [velocity] * 3))


def _stacked(believed: Sequence[_Placed], options: EstimatorOptions, name: str) -> MeasurementModel:
    names = [one.name for one in believed]
    for kind in options.measurements:
        choose(f"estimators.{name}.measurements", kind, names)
    used = [one.believed for one in believed if not options.measurements or one.name in options.measurements]
    return used[0] if len(used) == 1 else Stack(used)


def _check_seen(scenario: OwnScenario, sensors: Sequence[_Placed], target: Path, platforms: Path) -> None:
    """Refuse a target that nobody ever sees."""
    for one in sensors:
        mask, times = one.mask, one.clock.ticks(scenario.duration_s)
        if mask is None:
            continue
        picked = times[:: max(1, len(times) // 60)]
        states = np.array([target(float(t)) for t in picked])
        carriers = np.array([platforms(float(t)).reshape(-1, 6) for t in picked])
        if not mask.visible(states, carriers).any():
            raise UserError(
                f"sensors.{one.name}.minimum_elevation_deg: {one.field.minimum_elevation_deg:g} is not allowed; no "
                "platform ever sees the target"
            )


def declare(scenario: OwnScenario) -> Model:
    """Return platforms, target, sensors and what the estimators are given; see `diagrams.assembly`."""
    if not scenario.platforms:
        raise UserError("platforms: none is given; at least one is needed")
    constants, frame, duration = gravity_constants(scenario.constants), scenario.frame, scenario.duration_s
    paths = [path_of(m, frame, duration, constants, f"platforms.{n}") for n, m in scenario.platforms.items()]
    places = Places({name: i for i, name in enumerate(scenario.platforms)}, frame, constants)
    sensors = _placed(scenario, places)
    clock: Clock = sensors[0].clock if len(sensors) == 1 else Merged([one.clock for one in sensors])
    motion = _motion(scenario)
    mover = scenario.target.start if isinstance(scenario.target, RandomMotion) else scenario.target
    path = path_of(mover, frame, duration, constants, "target")

    def carriers(t: float) -> Array:
        return np.concatenate([one(t) for one in paths])

    _check_seen(scenario, sensors, path, carriers)
    rows = [row for one in sensors for row in one.real.names]
    spread = _spread(scenario.start.sigma_position_m, scenario.start.sigma_velocity_mps)
    start: Start = PortStart(spread)
    if isinstance(scenario.start, Given):
        start = GivenStart(path_of(scenario.start.at, frame, duration, constants, "start.at")(0.0), spread)

    def assume(bus: Bus, name: str, options: EstimatorOptions) -> Assumed:
        return Assumed(_stacked(sensors, options, name), motion, start, rows)

    parts: list[Part] = [Platforms(lambda: PathBlock(carriers, "carriers", 6 * len(paths)))]
    if isinstance(scenario.target, RandomMotion):
        about = _spread(scenario.target.sigma_position_m, scenario.target.sigma_velocity_mps)
        parts.append(ModelTarget(motion, clock, path(0.0), about))
    else:
        parts.append(lambda bus: bus.add(PathBlock(path, "target"), {"target": "state", "truth": "state"}))
    for one in sensors:
        parts += [TargetSensor(one.name, one.real, one.clock, one.mask), _impaired(one, frame)]
    parts.append(_Together([one.name for one in sensors]))
    parts.append(KnownPlatforms(scenario.platform_errors.sigma_position_m, scenario.platform_errors.sigma_velocity_mps))
    if isinstance(scenario.start, Prior):
        parts.append(_prior(spread))
    return Model(
        clock=clock,
        duration=duration,
        divergence=scenario.divergence_m,
        parts=parts,
        assume=assume,
        truth_motion=_true_motion(scenario, motion),
        truth_states=_STATES,
        frame=frame,
        rows=rows,
    )


def _prior(spread: Array) -> Part:
    def part(bus: Bus) -> None:
        prior = PriorEstimate(spread, bus.trials, bus.shape("target")[0])
        bus.add(prior, gives={"initial_estimate": "initial_estimate"})

    return part


def own_system(path: FilePath) -> System:
    """Return the system that a YAML file of a user's declares.

    Parameters
    ----------
    path : Path
        The file; what it says are the values of its scenario.
    """
    return System(name=path.stem, title=f"declared in {path.name}", scenario=OwnScenario, declare=declare)
