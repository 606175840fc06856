"""A target at rest."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.motion.base import MotionModel

__all__ = ["Stationary"]

Array = NDArray[np.float64]


class Stationary(MotionModel):
    r"""A fixed position, or one that walks at random: :math:`Q = \tilde q\,dt\,I`.

    Parameters
    ----------
    axes : int
        Number of space dimensions, 1 to 3.
    density : float
        :math:`\tilde q` [m^2/s], >= 0; 0 is a target at rest.
    """

    linear = True

    def __init__(self, axes: int = 2, density: float = 0.0) -> None:
        if axes not in (1, 2, 3):
            raise ValueError(f"axes: {axes} is not allowed; 1, 2 or 3")
        if not (math.isfinite(density) and density >= 0):
            raise ValueError(f"density: {density} is not allowed; it must be >= 0 m^2/s")
        self.axes = axes
        self.density = float(density)
        self.names = tuple("xyz"[:axes])
        self.units = ("m",) * axes

    def propagate(self, state: Array, dt: float) -> Array:
        """Return the same position."""
        return np.array(state, dtype=float)

    def transition(self, state: Array, dt: float) -> Array:
        """Return the identity, shape (n, n)."""
        return np.eye(self.axes)

    def process_noise(self, state: Array, dt: float) -> Array:
        """Return Q, shape (n, n)."""
        return self.density * dt * np.eye(self.axes)
