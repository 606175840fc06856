"""The position itself as a measurement: what an earlier fix, or another system, says of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import Equations, of_kernel
from quietfix.systems.measurement.base import CompiledModel, positive

__all__ = ["Position"]

Array = NDArray[np.float64]


class Position(CompiledModel):
    r"""Earth-fixed x, y and z, with independent errors.

    .. math:: h(x) = p, \qquad R = \sigma^2 I

    Parameters
    ----------
    sigma : float
        Standard deviation per axis [m].
    name : str
        Prefix of the row names.
    """

    units = ("m",) * 3

    def __init__(self, sigma: float, name: str = "position") -> None:
        self.sigma = positive(sigma, "sigma_position", "m")
        self.names = tuple(f"{name}_{axis}" for axis in "xyz")

    def equations(self) -> Equations:
        """See `MeasurementModel.equations`."""
        return of_kernel("states:components", [0, 1, 2], 3, states=3)

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return self.sigma**2 * np.eye(3)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """No platform is needed."""
        return np.zeros((3, platforms), dtype=bool)
