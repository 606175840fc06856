"""Random walks: oscillators, attitude drifts and whatever else only wanders."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.motion.base import MotionModel

__all__ = ["RandomWalk"]

Array = NDArray[np.float64]


class RandomWalk(MotionModel):
    r"""Independent random walks.

    .. math:: x_{k+1} = x_k + w_k, \qquad Q = \mathrm{diag}(q)\,\Delta t

    Parameters
    ----------
    densities : sequence of float
        Power spectral density of the rate of each component [unit^2/s], >= 0: its variance grows by this a second.
    names, units : sequence of str
        Names and SI units of the components.
    """

    linear = True

    def __init__(self, densities: Sequence[float], names: Sequence[str], units: Sequence[str]) -> None:
        if not densities or any(not (math.isfinite(q) and q >= 0) for q in densities):
            raise ValueError(f"random walk densities: {list(densities)} is not allowed; at least one, all >= 0")
        if not len(densities) == len(names) == len(units):
            raise ValueError("random walk: each component needs a density, a name and a unit")
        self.densities = np.array(densities, dtype=float)
        self.names, self.units = tuple(names), tuple(units)

    def propagate(self, state: Array, dt: float) -> Array:
        """See `MotionModel.propagate`."""
        return np.array(state, dtype=float)

    def transition(self, state: Array, dt: float) -> Array:
        """See `MotionModel.transition`."""
        return np.eye(self.size)

    def process_noise(self, state: Array, dt: float) -> Array:
        """See `MotionModel.process_noise`."""
        return np.diag(dt * self.densities)
