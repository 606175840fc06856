"""What a measurement model is."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import Equations, inherited_program
from quietfix.systems.kernels.evaluating import linearized, values

__all__ = ["CompiledModel", "MeasurementModel", "differenced_covariance", "positive"]

Array = NDArray[np.float64]


class MeasurementModel(ABC):
    """What a sensor reads of a target, seen from known platforms.

    All methods work over leading axes: `target` is (..., n) with Earth-fixed position [m] and velocity [m/s] in
    the first six components, `platforms` is (..., p, 6) and broadcasts against it.

    Attributes
    ----------
    names, units : tuple of str
        Names and SI units of the rows.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(self.names)

    @abstractmethod
    def predict(self, target: Array, platforms: Array) -> Array:
        """Return the noise-free measurement, shape (..., m)."""

    @abstractmethod
    def jacobian(self, target: Array, platforms: Array) -> Array:
        """Return the derivative of `predict` with respect to the target's state, shape (..., m, n)."""

    @abstractmethod
    def noise_covariance(self) -> Array:
        """Return the covariance of the measurement noise, shape (m, m)."""

    def noise_covariance_at(self, target: Array, platforms: Array) -> Array:
        """Return the covariance of the noise for a target there, shape (..., m, m) or, the same everywhere, (m, m)."""
        return self.noise_covariance()

    def linearize(self, target: Array, platforms: Array) -> tuple[Array, Array]:
        """Return `predict` and `jacobian`; a model whose two share work overrides this."""
        return self.predict(target, platforms), self.jacobian(target, platforms)

    def equations(self) -> Equations | None:
        """Return the model's compiled equations, where it has them: estimators then work at the speed of C.

        They must be those of `predict`, `jacobian` and `residual`; the state's further components may be ignored.
        """
        return None

    def modified_gain(self, measured: Array, target: Array, platforms: Array) -> Array:
        r"""Return the modified gain g, shape (..., m, n).

        It makes :math:`h(x) - h(\hat x) = g(z, \hat x)(x - \hat x)` exact for z = h(x).
        By default the Jacobian at the target's estimate: for most measurements no such g is known.
        """
        return self.jacobian(target, platforms)

    def residual(self, measured: Array, predicted: Array) -> Array:
        """Return ``measured - predicted``; models of angles and wrapped phases wrap it."""
        return measured - predicted

    def represent(self, value: Array) -> Array:
        """Return how a sensor would report `value`: unchanged, or wrapped into its interval."""
        return value

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """Return which of so many platforms each row needs, shape (m, platforms); by default all."""
        return np.ones((self.size, platforms), dtype=bool)

    @property
    def sigmas(self) -> Array:
        """Standard deviation of each row, shape (m,)."""
        return np.sqrt(np.diagonal(self.noise_covariance()))


class CompiledModel(MeasurementModel):
    """A model whose equations stand in its kernel alone: value and derivative over leading axes come from there."""

    @abstractmethod
    def equations(self) -> Equations:
        """See `MeasurementModel.equations`."""

    def predict(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.predict`."""
        return values(inherited_program(self), target, platforms)

    def jacobian(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.jacobian`."""
        return self.linearize(target, platforms)[1]

    def linearize(self, target: Array, platforms: Array) -> tuple[Array, Array]:
        """See `MeasurementModel.linearize`."""
        return linearized(inherited_program(self), target, platforms)


def positive(value: float, name: str, unit: str) -> float:
    """Return `value` if it is finite and > 0, else raise a ValueError that names it."""
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"{name}: {value} is not allowed; it must be a finite number > 0 {unit}")
    return float(value)


def differenced_covariance(sigma: float, rows: int, correlated: bool) -> Array:
    r"""Covariance of differences against a common reference receiver.

    Parameters
    ----------
    sigma : float
        Standard deviation of one difference.
    rows : int
        Number of differences.
    correlated : bool
        False: independent errors, as most papers write. True: every receiver's own error is
        :math:`s = \sigma/\sqrt 2`, and the reference's error is in every difference, so that the diagonal stays
        :math:`\sigma^2` and the rest is :math:`s^2 = \sigma^2/2`.

    Returns
    -------
    ndarray, shape (rows, rows)
    """
    share = 0.5 if correlated else 0.0
    return sigma**2 * ((1 - share) * np.eye(rows) + share * np.ones((rows, rows)))
