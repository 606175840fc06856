"""Errors that fade: a first-order Gauss-Markov process per axis."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.motion.base import MotionModel

__all__ = ["GaussMarkov"]

Array = NDArray[np.float64]


class GaussMarkov(MotionModel):
    r"""Stationary error with standard deviation sigma and correlation time tau.

    .. math:: x_{k+1} = e^{-dt/\tau} x_k + w, \qquad Q = \sigma^2 (1 - e^{-2 dt/\tau})\,I

    Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 8.2.

    Parameters
    ----------
    sigma : float
        Standard deviation per axis, >= 0 [m].
    time_constant : float
        tau, >= 0 [s]; 0 is white from step to step.
    axes : int
        Number of components.
    """

    linear = True

    def __init__(self, sigma: float, time_constant: float = 0.0, axes: int = 2) -> None:
        for name, value in (("sigma", sigma), ("time_constant", time_constant)):
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"{name}: {value} is not allowed; it must be >= 0")
        self.sigma, self.time_constant = float(sigma), float(time_constant)
        self.axes = axes
        self.names = tuple(f"error_{i}" for i in range(axes))
        self.units = ("m",) * axes

    def _kept(self, dt: float) -> float:
        return math.exp(-dt / self.time_constant) if self.time_constant > 0 else float(dt == 0)

    def propagate(self, state: Array, dt: float) -> Array:
        """Return the part of the error that is left."""
        return self._kept(dt) * np.asarray(state, dtype=float)

    def transition(self, state: Array, dt: float) -> Array:
        """Return its factor times the identity, shape (n, n)."""
        return self._kept(dt) * np.eye(self.axes)

    def process_noise(self, state: Array, dt: float) -> Array:
        """Return Q, shape (n, n)."""
        return self.sigma**2 * (1 - self._kept(dt) ** 2) * np.eye(self.axes)
