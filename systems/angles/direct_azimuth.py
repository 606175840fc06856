"""An azimuth that is itself a state."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angle_wrapping import wrap
from quietfix.systems.kernels.equations import Equations, of_kernel
from quietfix.systems.measurement.base import CompiledModel, positive

__all__ = ["DirectAzimuth"]

Array = NDArray[np.float64]


class DirectAzimuth(CompiledModel):
    r"""The first state component is measured, as an angle: H = [1, 0], R = sigma^2, residuals wrapped.

    Equation (12) of Huang, doi 10.3969/j.issn.1009-086x.2017.01.020. No platform is read.

    .. math:: z = \mathrm{wrap}(\theta + w), \qquad w \sim N(0, \sigma^2)

    Parameters
    ----------
    sigma : float
        Standard deviation [rad].
    """

    names = ("azimuth",)
    units = ("rad",)

    def __init__(self, sigma: float) -> None:
        self.sigma = positive(sigma, "sigma_bearing", "rad")

    def equations(self) -> Equations:
        """See `MeasurementModel.equations`."""
        return of_kernel("states:components", [0], 1, modulus=2 * np.pi, states=1)

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return np.array([[self.sigma**2]])

    def residual(self, measured: Array, predicted: Array) -> Array:
        """Return the difference, in [-pi, pi): the state's azimuth may have run past pi."""
        return wrap(measured - predicted)

    def represent(self, value: Array) -> Array:
        """Return the angle in [-pi, pi)."""
        return wrap(value)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """No platform is needed."""
        return np.zeros((1, platforms), dtype=bool)
