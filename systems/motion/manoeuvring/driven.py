"""Another motion, driven by white acceleration noise in addition."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.motion.base import MotionModel
from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration

__all__ = ["Driven"]

Array = NDArray[np.float64]


class Driven(MotionModel):
    r"""Another motion with the noise of a white acceleration added, so that it gives way to a manoeuvre.

    .. math:: Q = Q_0 + \tilde q \begin{bmatrix} dt^3/3\,I & dt^2/2\,I \\ dt^2/2\,I & dt\,I \end{bmatrix}

    Within a step the motion's own forces are taken not to act on what is added: exact for straight motion, and to
    the order of the step squared times the gradient of its acceleration else.

    Parameters
    ----------
    motion : MotionModel
        Its states begin with positions and their velocities, x, y, z, vx, vy, vz, or fewer axes of them.
    density : float
        Power spectral density of the acceleration per axis [m^2/s^3], >= 0.
    """

    def __init__(self, motion: MotionModel, density: float) -> None:
        axes = sum(name in ("x", "y", "z") for name in motion.names)
        straight = WhiteNoiseAcceleration(density, axes) if axes else None
        if straight is None or motion.names[: 2 * axes] != straight.names:
            raise ValueError(f"states {motion.names} are not allowed; they must begin with x, y, z, vx, vy, vz")
        if not (math.isfinite(density) and density >= 0):
            raise ValueError(f"density: {density} is not allowed; it must be >= 0 m^2/s^3")
        if motion.input_size:
            raise ValueError("a motion with an input is not allowed")
        self.motion, self._straight = motion, straight
        self.names, self.units, self.linear, self.nominal = motion.names, motion.units, motion.linear, motion.nominal

    def propagate(self, state: Array, dt: float) -> Array:
        """See `MotionModel.propagate`."""
        return self.motion.propagate(state, dt)

    def transition(self, state: Array, dt: float) -> Array:
        """See `MotionModel.transition`."""
        return self.motion.transition(state, dt)

    def process_noise(self, state: Array, dt: float) -> Array:
        """See `MotionModel.process_noise`."""
        noise = np.array(self.motion.process_noise(state, dt))
        own = self._straight.size
        noise[..., :own, :own] += self._straight.process_noise(state, dt)
        return noise
