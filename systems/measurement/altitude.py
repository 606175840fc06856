"""Height above the WGS-84 ellipsoid as a measurement: an assumed height, or a barometric altitude."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import Equations, of_kernel
from quietfix.systems.measurement.base import CompiledModel, positive

__all__ = ["Altitude"]

Array = NDArray[np.float64]


class Altitude(CompiledModel):
    r"""Geodetic height of the target; the gradient is the ellipsoid's outward normal.

    .. math:: h(x) = h_{\mathrm{WGS\,84}}(p), \qquad \partial h/\partial p = n^T,\quad
              n = (\cos\varphi\cos\lambda,\ \cos\varphi\sin\lambda,\ \sin\varphi)

    Parameters
    ----------
    sigma : float
        Standard deviation [m].
    name : str
        Name of the row.
    """

    units = ("m",)

    def __init__(self, sigma: float, name: str = "altitude") -> None:
        self.sigma = positive(sigma, "sigma_altitude", "m")
        self.names = (name,)

    def equations(self) -> Equations:
        """See `MeasurementModel.equations`."""
        return of_kernel("states:altitude", [], 1, states=3)

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return np.array([[self.sigma**2]])

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """No platform is needed."""
        return np.zeros((1, platforms), dtype=bool)
