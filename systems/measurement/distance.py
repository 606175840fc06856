"""Range from platforms to the target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.geometry.lines_of_sight import LineOfSight
from quietfix.systems.kernels.equations import Equations, of_kernel
from quietfix.systems.measurement.base import positive
from quietfix.systems.measurement.sighted import SightedModel

__all__ = ["Range"]

Array = NDArray[np.float64]


class Range(SightedModel):
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

    def predict_from(self, sight: LineOfSight, platforms: Array) -> Array:
        """See `SightedModel.predict_from`."""
        return sight.distance[..., self.stations]

    def linearize_from(self, sight: LineOfSight, platforms: Array, size: int) -> tuple[Array, Array]:
        """See `SightedModel.linearize_from`."""
        direction = sight.direction[..., self.stations, :]
        jacobian = np.zeros((*direction.shape[:-1], size))
        jacobian[..., :3] = direction
        return sight.distance[..., self.stations], jacobian

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return self.sigma**2 * np.eye(self.size)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """Each row needs its station."""
        used = np.zeros((self.size, platforms), dtype=bool)
        used[np.arange(self.size), self.stations] = True
        return used
