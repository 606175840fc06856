"""Range from platforms to the target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import Equations, of_kernel
from quietfix.systems.measurement.base import CompiledModel, positive

__all__ = ["Range"]

Array = NDArray[np.float64]


class Range(CompiledModel):
    r"""Distances from stations to the target.

    .. math:: z_i = r_i = |p - p_i|, \qquad \partial r_i/\partial p = u_i = (p - p_i)/r_i

    Parameters
    ----------
    sigma : float
        Standard deviation of one range [m].
    stations : sequence of int
        Platforms that measure.
    """

    def __init__(self, sigma: float, stations: Sequence[int]) -> None:
        self.sigma = positive(sigma, "sigma_range", "m")
        self.stations = list(stations)
        if not self.stations or len(set(self.stations)) < len(self.stations):
            raise ValueError(f"stations: {self.stations} is not allowed; at least one, none of them twice")
        self.names = tuple(f"range_{i}" for i in self.stations)
        self.units = ("m",) * len(self.names)

    def equations(self) -> Equations:
        """See `MeasurementModel.equations`."""
        return of_kernel("ranges:ranges", self.stations, self.size, states=3, platforms=self.stations)

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return self.sigma**2 * np.eye(self.size)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """Each row needs its station."""
        used = np.zeros((self.size, platforms), dtype=bool)
        used[np.arange(self.size), self.stations] = True
        return used
