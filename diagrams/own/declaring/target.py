"""The target of a system of one's own: how it moves, how that is believed, its oscillator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import OutputPort

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.own.classes import motions, plants
from quietfix.diagrams.own.declaring.along_track import add_plants, ahead_motions, ahead_sigmas
from quietfix.diagrams.own.fields.schema import Given, Orbital, Oscillator, OwnScenario, Prior
from quietfix.diagrams.parts.formation import gravity_constants
from quietfix.diagrams.parts.movers import ModelTarget
from quietfix.diagrams.paths.functions import Path
from quietfix.diagrams.paths.movers import (
    Fixed,
    Geodetic,
    Kepler,
    Offset,
    PositionVelocity,
    RandomMotion,
    Straight,
    StraightLine,
)
from quietfix.diagrams.quantities.frame import INERTIAL, LOCAL
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.along_track.anew import Anew
from quietfix.systems.clocks import Clock
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.motion import constant_velocity
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.motion.drifting_bias import DriftingBias
from quietfix.systems.motion.orbital import OrbitalMotion
from quietfix.systems.motion.random_walk import RandomWalk
from quietfix.systems.motion.side_by_side import SideBySide
from quietfix.systems.options.motions import CoordinatedTurn
from quietfix.systems.plants.joined import Joined
from quietfix.systems.plants.model_plant import ModelPlant
from quietfix.systems.plants.path import Path as PathBlock

__all__ = ["Target", "spread_of", "target_motion", "true_motion", "with_bias"]

Array = NDArray[np.float64]


def target_motion(scenario: OwnScenario) -> MotionModel:
    """Return how the target is believed to move, without its oscillator."""
    field = scenario.belief.motion
    if isinstance(field, motions.Custom):
        return field.model("belief.motion")
    if isinstance(field, Orbital):
        if scenario.axes is not INERTIAL:
            raise UserError(f"belief.motion: !Orbital is for frame inertial only, this is {scenario.frame}")
        constants = gravity_constants(scenario.constants)
        return OrbitalMotion(constants, constants.j2 != 0, density=field.density_m2ps3)
    if isinstance(field, CoordinatedTurn) and scenario.axes is not LOCAL:
        raise UserError(f"belief.motion: !CoordinatedTurn is for frame local only, this is {scenario.frame}")
    return field.model()


def with_bias(scenario: OwnScenario, motion: MotionModel, walk: float | None) -> MotionModel:
    """Return a target's motion with the oscillator's and the satellites' errors beside it, where there are any."""
    beside = [] if scenario.oscillator is None else [_anew(scenario, _wander(scenario.oscillator, walk))]
    beside += ahead_motions(scenario)
    return SideBySide([motion, *beside]) if beside else motion


def _anew(scenario: OwnScenario, wander: MotionModel) -> MotionModel:
    """Return how the oscillator's error is believed to move: unknown again after a pause, if it is said."""
    oscillator, start = scenario.oscillator, scenario.start
    if oscillator is None or oscillator.pause_s is None or not isinstance(start, Prior | Given):
        return wander
    return Anew(wander, _of_oscillator(oscillator, (start.sigma_offset_hz, start.sigma_drift_hzps)), oscillator.pause_s)


def _wander(oscillator: Oscillator, walk: float | None = None) -> MotionModel:
    """Return how the oscillator's error moves; `walk` [Hz^2/s] instead of its own."""
    square = _metres_per_hertz(oscillator) ** 2
    density = square * (oscillator.walk_hz2ps if walk is None else walk)
    if oscillator.drift_hzps is not None:
        return DriftingBias(density, square * oscillator.drift_walk_hz2ps3)
    for field in ("sigma_drift_hzps", "drift_walk_hz2ps3"):
        if value := getattr(oscillator, field):
            raise UserError(f"oscillator.{field}: {value:g} is not allowed without drift_hzps; 0, or a drift_hzps")
    return RandomWalk([density], ["bias"], ["m/s"])


def _metres_per_hertz(oscillator: Oscillator) -> float:
    """Return the size of a range rate that shifts the carrier by a hertz [m/s/Hz]."""
    return SPEED_OF_LIGHT / (oscillator.carrier_mhz * 1e6)


def true_motion(scenario: OwnScenario, believed: MotionModel) -> MotionModel | None:
    """Return the motion that the target really has, if it is one of the models."""
    target, motion = scenario.target, None
    if isinstance(target, RandomMotion):
        motion = believed
    elif isinstance(target, Kepler | PositionVelocity | Offset) and scenario.axes is INERTIAL:
        constants = gravity_constants(scenario.constants)
        motion = OrbitalMotion(constants, constants.j2 != 0)
    elif isinstance(target, Fixed | Straight) or (
        isinstance(target, Geodetic | StraightLine) and scenario.axes.geodetic
    ):
        motion = constant_velocity.ConstantVelocity(0.0)
    return None if motion is None else with_bias(scenario, motion, None)


def spread_of(scenario: OwnScenario, position: float, velocity: float, oscillator: tuple[float, float]) -> Array:
    """Return the covariance of a state: standard deviations per axis [m], [m/s], of the oscillator [Hz], [Hz/s]."""
    sigmas = [position] * 3 + [velocity] * 3
    if scenario.oscillator is not None:
        sigmas += _of_oscillator(scenario.oscillator, oscillator)
    sigmas += ahead_sigmas(scenario)
    return np.diag(np.square(sigmas))


def _of_oscillator(oscillator: Oscillator, numbers: tuple[float, float]) -> list[float]:
    """Return numbers [Hz], [Hz/s] as those of its states [m/s], [m/s^2]."""
    states = 1 if oscillator.drift_hzps is None else 2
    return [number * _metres_per_hertz(oscillator) for number in numbers[:states]]


@dataclass(frozen=True)
class Target:
    """What is looked for, with its oscillator: publishes ``target`` and ``truth``."""

    scenario: OwnScenario
    motion: MotionModel
    path: Path
    clock: Clock

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        target, oscillator = self.scenario.target, self.scenario.oscillator
        bias: list[float] = []
        drawn = (0.0, 0.0)
        if oscillator is not None:
            bias = _of_oscillator(oscillator, (-oscillator.offset_hz, -(oscillator.drift_hzps or 0.0)))
            drawn = oscillator.sigma_offset_hz, oscillator.sigma_drift_hzps
        if isinstance(target, RandomMotion):
            about = spread_of(self.scenario, target.sigma_position_m, target.sigma_velocity_mps, drawn)
            motion = with_bias(self.scenario, self.motion, None)
            mean = np.concatenate([self.path(0.0), bias, np.zeros(len(self.scenario.along_track))])
            ModelTarget(motion, self.clock, mean, about)(bus)
            return
        alone = oscillator is None and not self.scenario.along_track
        flight = self._flight(bus, "target" if alone else "flight")
        if alone:
            bus.publish(target=flight, truth=flight)
            return
        parts = {"flight": "flight.state"}
        if oscillator is not None:
            self._add_oscillator(bus, oscillator, bias, drawn)
            parts["oscillator"] = "oscillator.state"
        parts |= {block: f"{block}.state" for block in add_plants(bus, self.scenario, self.clock)}
        shapes = {name: bus.shape(signal) for name, signal in parts.items()}
        bus.add(Joined(shapes, "target"), gives={"target": "state", "truth": "state"}, takes=parts)

    def _add_oscillator(self, bus: Bus, oscillator: Oscillator, bias: list[float], drawn: tuple[float, float]) -> None:
        variance = np.diag(np.square(_of_oscillator(oscillator, drawn)))
        random = any(drawn) or oscillator.walk_hz2ps or oscillator.drift_walk_hz2ps3
        trials = bus.trials if random else 1
        bus.add(ModelPlant(_wander(oscillator), self.clock, bias, variance, trials, name="oscillator"))

    def _flight(self, bus: Bus, name: str) -> OutputPort:
        """Add what moves, without its oscillator; return its state (trials or 1, 6)."""
        if isinstance(self.scenario.target, plants.Custom):
            return plants.add_plant(self.scenario.target, bus, name).GetOutputPort("state")
        return bus.add(PathBlock(self.path, name)).GetOutputPort("state")
