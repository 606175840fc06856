"""Parts that move: what carries sensors, and what is looked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.parts.formation import GreatCircle, Motion, RandomAcceleration
from quietfix.systems.clocks import Clock
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.motion.constant_velocity import ConstantVelocity
from quietfix.systems.plants.emitter import GreatCircle as GreatCirclePlant
from quietfix.systems.plants.emitter import StraightLine as StraightLinePlant
from quietfix.systems.plants.model_plant import ModelPlant
from quietfix.systems.signals import EnsembleBlock

__all__ = ["Emitter", "ModelTarget", "Platforms", "true_motion"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Platforms:
    """What carries the sensors; publishes ``platforms``.

    Attributes
    ----------
    make : callable
        Returns their block, a new one for each diagram.
    port : str
        Its output with six numbers for each platform.
    """

    make: Callable[[], EnsembleBlock]
    port: str = "state"

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        bus.add(self.make(), gives={"platforms": self.port})


@dataclass(frozen=True)
class ModelTarget:
    """A target that moves as a motion model has it; publishes ``target`` and ``truth``.

    Attributes
    ----------
    motion : MotionModel
    clock : Clock
        When its process noise is drawn.
    mean, covariance : ndarray, shapes (n,) and (n, n)
        Of its state at the start.
    shared : bool
        Whether all trials have the same one.
    name : str
        Of the block; part of the key of its noise.
    """

    motion: MotionModel
    clock: Clock
    mean: Array
    covariance: Array
    shared: bool = False
    name: str = "target"

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        trials = 1 if self.shared else bus.trials
        plant = ModelPlant(self.motion, self.clock, self.mean, self.covariance, trials, name=self.name)
        bus.add(plant, gives={"target": "state", "truth": "state"})


@dataclass(frozen=True)
class Emitter:
    """The emitter that is looked for; publishes ``target`` and ``truth``.

    Attributes
    ----------
    motion : Motion
        How it moves. One that accelerates at random starts at the place of `start`, with a velocity of its own in
        every trial.
    start : ndarray, shape (6,)
        Earth-fixed, at t = 0.
    clock : Clock
        When a random acceleration changes.
    """

    motion: Motion
    start: Array
    clock: Clock

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        bus.add(self._block(bus.trials), gives={"target": "state", "truth": "state"})

    def _block(self, trials: int) -> ModelPlant | GreatCirclePlant | StraightLinePlant:
        if isinstance(self.motion, RandomAcceleration):
            mean = np.concatenate([self.start[:3], np.zeros(3)])
            spread = np.diag([0.0] * 3 + [self.motion.sigma_velocity_mps**2] * 3)
            return ModelPlant(true_motion(self.motion), self.clock, mean, spread, trials, name="emitter")
        kind = GreatCirclePlant if isinstance(self.motion, GreatCircle) else StraightLinePlant
        return kind(self.start, name="emitter")


def true_motion(motion: Motion) -> ConstantVelocity:
    """Return the motion model that an emitter really has."""
    return ConstantVelocity(motion.acceleration_mps2 if isinstance(motion, RandomAcceleration) else 0.0)
