"""An oscillator whose error drifts: a bias, and the rate at which it grows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.motion.base import MotionModel

__all__ = ["DriftingBias"]

Array = NDArray[np.float64]


class DriftingBias(MotionModel):
    r"""A bias b that grows at a rate r, with :math:`\dot b = r + w_b` and :math:`\dot r = w_r`, both white.

    Over a step the state (b, r) goes over by [[1, dt], [0, 1]], with the noise

    .. math:: Q = q_b \begin{pmatrix} dt & 0\\ 0 & 0\end{pmatrix} + q_r
              \begin{pmatrix} dt^3/3 & dt^2/2\\ dt^2/2 & dt\end{pmatrix},

    the two-state clock of Brown and Hwang, *Introduction to Random Signals and Applied Kalman Filtering*, section 9.3,
    exact for any step.

    Parameters
    ----------
    density, rate_density : float
        Power spectral densities of w_b [(m/s)^2/s] and w_r [(m/s^2)^2/s], >= 0.
    """

    linear = True
    names = ("bias", "bias_rate")
    units = ("m/s", "m/s^2")

    def __init__(self, density: float, rate_density: float = 0.0) -> None:
        for q in (density, rate_density):
            if not (math.isfinite(q) and q >= 0):
                raise ValueError(f"drifting bias: density {q} is not allowed; it must be >= 0")
        self.density, self.rate_density = float(density), float(rate_density)

    def propagate(self, state: Array, dt: float) -> Array:
        """See `MotionModel.propagate`."""
        state = np.array(state, dtype=float)
        state[..., 0] += dt * state[..., 1]
        return state

    def transition(self, state: Array, dt: float) -> Array:
        """See `MotionModel.transition`."""
        return np.array([[1.0, dt], [0.0, 1.0]])

    def process_noise(self, state: Array, dt: float) -> Array:
        """See `MotionModel.process_noise`."""
        wander = self.rate_density * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        return wander + np.diag([self.density * dt, 0.0])
