"""Differences of a quantity between receivers and a common reference receiver."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.constants import EARTH_RATE
from quietfix.systems.measurement.base import CompiledModel, differenced_covariance
from quietfix.systems.trajectories.gravity import GravityConstants

__all__ = ["Differenced"]

Array = NDArray[np.float64]


class Differenced(CompiledModel):
    """A quantity at receivers minus the same quantity at the reference; base of `Tdoa` and `Fdoa`.

    Parameters
    ----------
    kind, unit : str
        Prefix of the row names, unit of the rows.
    sigma : float
        Standard deviation of one difference.
    receivers : sequence of int
        Platforms that are compared with the reference.
    reference : int
        The reference platform.
    correlated : bool
        Errors correlated through the common reference; see `differenced_covariance`.
    light_time : bool
        False: geometry of one instant. True: one wave front, see `quietfix.systems.geometry.light_time.arrival`.
    earth_rate : float
        Rotation of the Earth-fixed axes [rad/s]; only used with `light_time`.
    constants : GravityConstants, optional
        Gravity that bends the orbits of receivers, the same.
    """

    def __init__(
        self,
        kind: str,
        unit: str,
        sigma: float,
        receivers: Sequence[int],
        reference: int,
        correlated: bool,
        light_time: bool,
        earth_rate: float = EARTH_RATE,
        constants: GravityConstants | None = None,
    ) -> None:
        self.sigma = sigma
        self.receivers = list(receivers)
        self.reference = reference
        self.correlated = correlated
        self.light_time = light_time
        self.earth_rate = earth_rate
        self.constants = constants
        if reference in self.receivers or len(set(self.receivers)) < len(self.receivers):
            raise ValueError(f"receivers: {self.receivers} must be different and exclude reference {reference}")
        self.names = tuple(f"{kind}_{i}{reference}" for i in self.receivers)
        self.units = (unit,) * len(self.names)

    def _wave_parameters(self) -> list[float]:
        """Return what the kernels of one wave front begin with: Earth rate, mu, radius, 1.5 J2 R^2."""
        earth = self.constants or GravityConstants()
        return [self.earth_rate, earth.mu, earth.radius, 1.5 * earth.j2 * earth.radius**2]

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return differenced_covariance(self.sigma, self.size, self.correlated)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """Each row needs its receiver and the reference."""
        used = np.zeros((self.size, platforms), dtype=bool)
        used[:, self.reference] = True
        used[np.arange(self.size), self.receivers] = True
        return used
