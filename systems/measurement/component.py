"""A component of the target's state, measured as it is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import Equations, of_kernel
from quietfix.systems.measurement.base import CompiledModel, positive

__all__ = ["Component"]

Array = NDArray[np.float64]


class Component(CompiledModel):
    r"""One component of the state, such as the height z in local axes.

    .. math:: h(x) = x_k, \qquad R = \sigma^2

    Parameters
    ----------
    index : int
        Which one.
    sigma : float
        Standard deviation, in its unit.
    name, unit : str
        Of the row.
    """

    def __init__(self, index: int, sigma: float, name: str, unit: str) -> None:
        self.index, self.sigma = index, positive(sigma, f"sigma of {name}", unit)
        self.names, self.units = (name,), (unit,)

    def equations(self) -> Equations:
        """See `MeasurementModel.equations`."""
        return of_kernel("states:components", [self.index], 1, states=self.index + 1)

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return np.array([[self.sigma**2]])

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """No platform is needed."""
        return np.zeros((1, platforms), dtype=bool)
