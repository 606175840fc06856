r"""Place of what stands still, from all epochs together: maximum likelihood from many starts, and what else fits.

The epochs' rows are one long measurement of one place, so that

.. math:: \hat p = \arg\min_p \sum_k [z_k - h_k(p)]^T R_k^{-1} [z_k - h_k(p)]

is a `snapshot_fix` of it. Rows may depend on the velocity, which is zero: receivers that move see a Doppler shift.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.fixes.snapshot import snapshot_fix
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["Epochs", "StandingFix", "averaged", "standing_fix"]

Array = NDArray[np.float64]

_AS_GOOD = 9.21  # more of the cost: 99 % of chi-square with two degrees of freedom
_LARGER = (1.0, 10.0, 100.0, 1000.0)
_APART = 25.0  # squared distance in sigmas; nearer, it is the same minimum


class StandingFix(NamedTuple):
    """A place.

    Attributes
    ----------
    position : ndarray, shape (3,)
        [m]; NaN where the rows determine none.
    covariance : ndarray, shape (3, 3)
        Inverse of the information there.
    cost, dof : float
        The minimum; chi-square with so many degrees of freedom if model and noise are right.
    others : ndarray, shape (o, 3)
        Other minima that fit as well, to within a cost of 9.2 (99 % of chi-square with 2 degrees of freedom).
    """

    position: Array
    covariance: Array
    cost: float
    dof: float
    others: Array


class Epochs(MeasurementModel):
    """The rows of a model at several epochs; the platforms of all of them stand side by side on the port.

    Parameters
    ----------
    model : MeasurementModel
        Of one epoch.
    count : int
        Number of epochs.
    """

    def __init__(self, model: MeasurementModel, count: int) -> None:
        self._model, self._count = model, count
        self.names = tuple(f"{name}@{k}" for k in range(count) for name in model.names)
        self.units = tuple(model.units) * count

    def _split(self, target: Array, platforms: Array) -> tuple[Array, Array]:
        *lead, places, size = platforms.shape
        apart = platforms.reshape(*lead, self._count, places // self._count, size)
        shape = (*np.broadcast_shapes(tuple(lead), target.shape[:-1]), self._count, target.shape[-1])
        return np.broadcast_to(target[..., None, :], shape).copy(), apart

    def predict(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.predict`."""
        value = self._model.predict(*self._split(target, platforms))
        return value.reshape(*value.shape[:-2], self.size)

    def jacobian(self, target: Array, platforms: Array) -> Array:
        """See `MeasurementModel.jacobian`."""
        rows = self._model.jacobian(*self._split(target, platforms))
        return rows.reshape(*rows.shape[:-3], self.size, rows.shape[-1])

    def residual(self, measured: Array, predicted: Array) -> Array:
        """See `MeasurementModel.residual`."""
        whole = np.broadcast_shapes(measured.shape, predicted.shape)
        shape = (*whole[:-1], self._count, self._model.size)
        one, other = (np.broadcast_to(values, whole).reshape(shape) for values in (measured, predicted))
        return self._model.residual(one, other).reshape(whole)

    def platforms_used(self, platforms: int) -> NDArray[np.bool_]:
        """Rows of an epoch need its platforms only."""
        each = self._model.platforms_used(platforms // self._count)
        used: NDArray[np.bool_] = np.kron(np.eye(self._count, dtype=bool), each)
        return used

    def noise_covariance(self) -> Array:
        """See `MeasurementModel.noise_covariance`."""
        return np.kron(np.eye(self._count), self._model.noise_covariance()).astype(float, copy=False)


def averaged(measurement: Array, sigma: Array) -> tuple[Array, Array]:
    """Return the weighted mean over epochs of each row, and its standard deviation, for what does not change.

    Parameters
    ----------
    measurement, sigma : ndarray, shape (k, m)
        NaN where a row is missing.

    Returns
    -------
    ndarray, shape (1, m)
        NaN of a row that is never there.
    ndarray, shape (1, m)
    """
    there = np.isfinite(measurement) & np.isfinite(sigma)
    weight = np.where(there, 1 / np.square(np.where(there, sigma, 1.0)), 0.0)
    total = weight.sum(axis=0, keepdims=True)
    some = np.where(total > 0, total, np.nan)
    mean = (weight * np.where(there, measurement, 0.0)).sum(axis=0, keepdims=True) / some
    return mean, 1 / np.sqrt(some)


def standing_fix(
    measurement: Array, sigma: Array, platforms: Array, model: MeasurementModel, starts: Array
) -> StandingFix:
    """Return the place, of all starts that with the lowest minimum.

    Parameters
    ----------
    measurement, sigma : ndarray, shape (k, m)
        Of each epoch, NaN where a row is missing.
    platforms : ndarray, shape (k, p, 6)
    model : MeasurementModel
        Of one epoch; its noise says how errors of one epoch are correlated, `sigma` how large they are.
    starts : ndarray, shape (s, 3)
        Where the search begins [m].
    """
    count = measurement.shape[0]
    base = model.noise_covariance()
    scale = np.nan_to_num(sigma, nan=1.0) / np.sqrt(np.diagonal(base))
    noise = np.zeros((measurement.size, measurement.size))
    for k, one in enumerate(scale):  # a few dozen epochs
        own = slice(k * one.size, (k + 1) * one.size)
        noise[own, own] = one[:, None] * base * one
    # Rows that contradict each other by many sigmas have a minimum that is reached slowly: with larger sigmas it is the
    # same one, and the same change of its cost is a longer step.
    for larger in _LARGER:
        fix = snapshot_fix(
            measurement.reshape(1, -1),
            platforms.reshape(1, -1, 6),
            Epochs(model, count),
            larger**2 * noise,
            starts[:, None, :],
        )
        position, covariance, cost = fix.position, fix.covariance / larger**2, fix.cost * larger**2
        found = np.flatnonzero(np.isfinite(cost))
        if found.size:
            break
    else:
        return StandingFix(np.full(3, np.nan), np.full((3, 3), np.nan), np.nan, float(fix.dof[0]), np.empty((0, 3)))
    order = found[np.argsort(cost[found], kind="stable")]
    kept = [int(order[0])]
    for i in order[1:]:
        away = position[kept] - position[i]
        distance = [float(d @ np.linalg.solve(covariance[j], d)) for d, j in zip(away, kept, strict=True)]
        if cost[i] - cost[kept[0]] < _AS_GOOD and min(distance) > _APART:
            kept.append(int(i))
    best = kept[0]
    return StandingFix(position[best], covariance[best], float(cost[best]), float(fix.dof[best]), position[kept[1:]])
