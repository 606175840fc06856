"""An oscillator whose error drifts: a bias, and the rate at which it grows."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.motion.constant_velocity import WhiteNoiseAcceleration

__all__ = ["DriftingBias"]

Array = NDArray[np.float64]


class DriftingBias(WhiteNoiseAcceleration):
    r"""A bias b that grows at a rate r, with :math:`\dot b = r + w_b` and :math:`\dot r = w_r`, both white.

    Over a step the state (b, r) goes over by [[1, dt], [0, 1]], with the noise

    .. math:: Q = q_b \begin{pmatrix} dt & 0\\ 0 & 0\end{pmatrix} + q_r
              \begin{pmatrix} dt^3/3 & dt^2/2\\ dt^2/2 & dt\end{pmatrix},

    the two-state clock of Brown and Hwang, *Introduction to Random Signals and Applied Kalman Filtering*, section 9.3,
    exact for any step: white acceleration along one axis, and what the bias itself walks.

    Parameters
    ----------
    density, rate_density : float
        Power spectral densities of w_b [(m/s)^2/s] and w_r [(m/s^2)^2/s], >= 0.
    """

    def __init__(self, density: float, rate_density: float = 0.0) -> None:
        for q in (density, rate_density):
            if not (math.isfinite(q) and q >= 0):
                raise ValueError(f"drifting bias: density {q} is not allowed; it must be >= 0")
        super().__init__(rate_density, axes=1)
        self.names, self.units = ("bias", "bias_rate"), ("m/s", "m/s^2")
        self.bias_density = float(density)

    def process_noise(self, state: Array, dt: float) -> Array:
        """See `MotionModel.process_noise`."""
        return super().process_noise(state, dt) + np.diag([self.bias_density * dt, 0.0])
