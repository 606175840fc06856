"""Differences of a quantity between receivers and a common reference receiver."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.constants import EARTH_RATE
from quietfix.systems.geometry.light_time import Arrival, arrival
from quietfix.systems.geometry.lines_of_sight import LineOfSight
from quietfix.systems.measurement.base import differenced_covariance
from quietfix.systems.measurement.sighted import SightedModel
from quietfix.systems.trajectories.gravity import GravityConstants

__all__ = ["Differenced"]

Array = NDArray[np.float64]


class Differenced(SightedModel):
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
        self.shares_sight = not light_time
        self.earth_rate = earth_rate
        self.constants = constants
        if reference in self.receivers or len(set(self.receivers)) < len(self.receivers):
            raise ValueError(f"receivers: {self.receivers} must be different and exclude reference {reference}")
        self.names = tuple(f"{kind}_{i}{reference}" for i in self.receivers)
        self.units = (unit,) * len(self.names)
        first, count = min(self.receivers, default=0), len(self.receivers)
        in_a_row = self.receivers == list(range(first, first + count))
        # a view instead of a copy
        self._picked: list[int] | slice = slice(first, first + count) if in_a_row else self.receivers

    @abstractmethod
    def values_from(self, sight: LineOfSight) -> Array:
        """Return the quantity at every platform, shape (..., p)."""

    @abstractmethod
    def gradients_from(self, sight: LineOfSight) -> Array:
        """Return its derivative with respect to the first k state components, shape (..., p, k)."""

    @abstractmethod
    def values_of(self, wave: Arrival) -> Array:
        """Return the quantity of one wave front, shape (..., p)."""

    @abstractmethod
    def gradients_of(self, wave: Arrival) -> Array:
        """Return its derivative, shape (..., p, 6)."""

    def _wave_parameters(self) -> list[float]:
        """Return what the kernels of one wave front begin with: Earth rate, mu, radius, 1.5 J2 R^2."""
        earth = self.constants or GravityConstants()
        return [self.earth_rate, earth.mu, earth.radius, 1.5 * earth.j2 * earth.radius**2]

    def _difference(self, values: Array) -> Array:
        return values[..., self._picked] - values[..., self.reference, None]

    def _difference_rows(self, gradients: Array, size: int) -> Array:
        jacobian = np.zeros((*gradients.shape[:-2], self.size, size))
        reference = gradients[..., self.reference, None, :]
        np.subtract(gradients[..., self._picked, :], reference, out=jacobian[..., : gradients.shape[-1]])
        return jacobian

    def predict_from(self, sight: LineOfSight, platforms: Array) -> Array:
        """See `SightedModel.predict_from`."""
        return self._difference(self.values_from(sight))

    def linearize_from(self, sight: LineOfSight, platforms: Array, size: int) -> tuple[Array, Array]:
        """See `SightedModel.linearize_from`."""
        return self._difference(self.values_from(sight)), self._difference_rows(self.gradients_from(sight), size)

    def _wave(self, target: Array, platforms: Array) -> Arrival:
        return arrival(target, platforms, self.reference, self.earth_rate, self.constants)

    def predict(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.predict`."""
        if not self.light_time:
            return super().predict(target, platforms)
        return self._difference(self.values_of(self._wave(target, platforms)))

    def linearize(self, target: Array, platforms: Array) -> tuple[Array, Array]:
        """See `MeasurementModel.linearize`."""
        if not self.light_time:
            return super().linearize(target, platforms)
        wave = self._wave(target, platforms)
        rows = self._difference_rows(self.gradients_of(wave), target.shape[-1])
        return self._difference(self.values_of(wave)), rows

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return differenced_covariance(self.sigma, self.size, self.correlated)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """Each row needs its receiver and the reference."""
        used = np.zeros((self.size, platforms), dtype=bool)
        used[:, self.reference] = True
        used[np.arange(self.size), self.receivers] = True
        return used
