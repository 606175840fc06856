"""Deviations from a flight whose accelerations are known."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.motion.base import MotionModel

__all__ = ["KnownFlight"]

Array = NDArray[np.float64]


class KnownFlight(MotionModel):
    r"""Deviation of a vehicle from one whose acceleration is a known function of time.

    .. math:: \delta r' = \delta r + \delta v\,\Delta t, \quad \delta v' = \delta v, \quad
              \delta a' = \delta a, \quad \delta b' = \delta b + w, \; w \sim N(0, q\,\Delta t)

    It is what the bounds take for a vehicle that flies a program: with the acceleration known, the place and the
    velocity at the start are all that is not, and an error in one's idea of the acceleration takes no part. Whoever
    must estimate the acceleration as well does worse. (Gravity and drag differ beside the flight; that is left out.)

    Parameters
    ----------
    bias_densities : sequence of float
        q: variance that each bias gains per second; one state ``bias`` (``bias_0`` ...) each, as in
        `CurrentStatistical`.

    Raises
    ------
    ValueError
        For a density that is not finite or negative.
    """

    linear = True

    def __init__(self, bias_densities: Sequence[float] = ()) -> None:
        for q in bias_densities:
            if not (math.isfinite(q) and q >= 0):
                raise ValueError(f"bias_densities: {q} is not allowed; finite numbers >= 0")
        self._densities = np.array(bias_densities, dtype=float)
        count = len(bias_densities)
        biases = ("bias",) if count == 1 else tuple(f"bias_{i}" for i in range(count))
        self.names = ("x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az", *biases)
        self.units = ("m",) * 3 + ("m/s",) * 3 + ("m/s^2",) * 3 + ("m/s",) * count

    def propagate(self, state: Array, dt: float) -> Array:
        """Return the deviation `dt` seconds later."""
        return (self.transition(state, dt) @ state[..., None])[..., 0]

    def transition(self, state: Array, dt: float) -> Array:
        """Return the transition matrix, shape (n, n)."""
        phi = np.eye(self.size)
        phi[:3, 3:6] = dt * np.eye(3)
        return phi

    def process_noise(self, state: Array, dt: float) -> Array:
        """Return the covariance of the process noise, shape (n, n): of the biases alone."""
        return np.diag(np.concatenate([np.zeros(9), self._densities * dt]))
