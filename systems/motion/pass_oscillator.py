"""A station that stays where it is and a transmitter's oscillator that starts anew in every pass."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.motion.base import MotionModel

__all__ = ["PassOscillator"]

Array = NDArray[np.float64]


class PassOscillator(MotionModel):
    r"""Position x, y, z that is constant, and a bias with its time derivatives.

    Within a pass the bias is a polynomial, :math:`b(t) = \sum_k b_k t^k/k!`, and its derivatives are states too. After
    a pause longer than `pause` bias and derivatives are unknown again: mean zero, variances those of the start.

    Parameters
    ----------
    sigmas : sequence of float
        Standard deviation at the start of a pass of the bias [m/s], its rate [m/s^2], the rate's rate [m/s^3] ...; as
        many as there are states for it, at least one, all > 0.
    pause : float
        [s], > 0.
    density : float
        Power spectral density of the last derivative's rate [(its unit)^2/s], >= 0.
    """

    def __init__(self, sigmas: Sequence[float], pause: float, density: float = 0.0) -> None:
        if not sigmas or any(not (math.isfinite(s) and s > 0) for s in sigmas):
            raise ValueError(f"oscillator sigmas: {list(sigmas)} is not allowed; at least one, all > 0")
        if not pause > 0:
            raise ValueError(f"pause: {pause} is not allowed; it must be > 0 s")
        if not (math.isfinite(density) and density >= 0):
            raise ValueError(f"density: {density} is not allowed; it must be >= 0")
        self.sigmas, self.pause, self.density = tuple(float(s) for s in sigmas), float(pause), float(density)
        k = len(self.sigmas)
        self.names = ("x", "y", "z", "bias", *(f"bias_rate_{i}" for i in range(1, k)))
        self.units = ("m",) * 3 + tuple("m/s" if i == 0 else f"m/s^{i + 1}" for i in range(k))

    # Linear, but what a pause does is no power of what a second does: the laws of a linear motion do not hold for it.
    linear = True

    def propagate(self, state: Array, dt: float) -> Array:
        """See `MotionModel.propagate`."""
        return np.einsum("ij,...j->...i", self.transition(state, dt), state)

    def transition(self, state: Array, dt: float) -> Array:
        """See `MotionModel.transition`; shape (n, n)."""
        n = self.size
        phi = np.eye(n)
        for i in range(3, n):
            for j in range(i, n):
                phi[i, j] = 0.0 if dt > self.pause else dt ** (j - i) / math.factorial(j - i)
        return phi

    def process_noise(self, state: Array, dt: float) -> Array:
        """See `MotionModel.process_noise`; shape (n, n)."""
        q = np.zeros((self.size, self.size))
        if dt > self.pause:
            q[3:, 3:] = np.diag(np.square(self.sigmas))
            return q
        k = len(self.sigmas)
        # White noise on the last derivative, integrated down the chain.
        for i in range(k):
            for j in range(k):
                a, b = k - 1 - i, k - 1 - j
                q[3 + i, 3 + j] = (
                    self.density * dt ** (a + b + 1) / ((a + b + 1) * math.factorial(a) * math.factorial(b))
                )
        return q
