"""Motions as a user writes them; the class name is the YAML tag."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

from quietfix.systems.documented import Allowed, documented, number
from quietfix.systems.motion import constant_velocity
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.motion.manoeuvring import coordinated_turn

__all__ = ["ConstantVelocity", "CoordinatedTurn", "FreeMotion", "WhiteNoiseAcceleration"]


class FreeMotion(ABC):
    """A motion of positions and velocities that nothing but its own numbers says."""

    @abstractmethod
    def model(self, axes: int = 3) -> MotionModel:
        """Return the motion model, in so many dimensions."""


@dataclass
class WhiteNoiseAcceleration(FreeMotion):
    """Straight on, driven by white acceleration noise in continuous time: fit for any mixture of rates."""

    density_m2ps3: float = number("power spectral density of the acceleration per axis [m^2/s^3]", 0.1, at_least=0)

    def model(self, axes: int = 3) -> MotionModel:
        """See `FreeMotion.model`."""
        return constant_velocity.WhiteNoiseAcceleration(self.density_m2ps3, axes)


@dataclass
class ConstantVelocity(FreeMotion):
    """Straight on, with an acceleration drawn anew in every step: two steps of 1 s have less noise than one of 2 s."""

    acceleration_mps2: float = number("standard deviation of the acceleration in a step [m/s^2]", 0.1, at_least=0)

    def model(self, axes: int = 3) -> MotionModel:
        """See `FreeMotion.model`."""
        return constant_velocity.ConstantVelocity(self.acceleration_mps2, axes)


@dataclass
class CoordinatedTurn(FreeMotion):
    """Turns at a known rate about the vertical, driven by white acceleration noise; where z is up everywhere."""

    rate_degps: float = documented(
        "turn rate [deg/s], not 0; positive to the left, counter-clockwise as seen from above",
        3.0,
        allowed=Allowed(lambda v: math.isfinite(v) and v != 0, "a finite number other than 0", divisor=False),
    )
    density_m2ps3: float = number("power spectral density of the acceleration per axis [m^2/s^3]", 0.1, at_least=0)

    def model(self, axes: int = 3) -> MotionModel:
        """See `FreeMotion.model`."""
        return coordinated_turn.CoordinatedTurn(math.radians(self.rate_degps), self.density_m2ps3, axes)
