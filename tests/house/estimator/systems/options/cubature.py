"""The cubature Kalman filter, as it is printed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.estimators.kalman_options import FilterOptions
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.square_root import Posterior, report
from quietfix.systems.filters.whitening import missing_rows
from quietfix.systems.linear_algebra import cholesky, symmetric
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel

__all__ = ["Cubature"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cubature(FilterOptions):
    r"""Cubature Kalman filter: 2 n points :math:`\bar x \pm \sqrt n\,L e_i` of equal weight.

    Arasaratnam and Haykin, *Cubature Kalman filters*, IEEE Trans. Automatic Control 54 (2009) 1254-1269, appendix A:
    means and covariances over the points, :math:`W = P_{xz} P_{zz}^{-1}`, :math:`P^+ = P - W P_{zz} W^T`.
    """

    def predict(self, mean: Array, covariance: Array, motion: MotionModel, dt: float) -> tuple[Array, Array]:
        """See `GaussianFilter.predict`."""
        moved = motion.propagate(_points(mean, covariance), dt)
        middle = moved.mean(axis=-2)
        off = (moved - middle[..., None, :]) / math.sqrt(moved.shape[-2])
        return middle, symmetric(np.swapaxes(off, -1, -2) @ off) + motion.process_noise(mean, dt)

    def update(self, mean: Array, covariance: Array, observation: Observation, model: MeasurementModel) -> Posterior:
        """See `GaussianFilter.update`; rows are whitened, so that one that is missing is 0 and of unit noise."""
        points = _points(mean, covariance)
        scale = 1 / math.sqrt(points.shape[-2])
        values = model.predict(points, observation.platforms[:, None])
        first = values[..., 0, :]  # angles are averaged as differences from one of them
        apart = model.residual(values, first[..., None, :])
        middle = apart.mean(axis=-2)
        innovation = model.residual(observation.value, first) - middle
        missing = missing_rows(innovation)
        if missing is not None:
            innovation = np.where(missing, 0.0, innovation)
            apart = np.where(missing[..., None, :], 0.0, apart)
            middle = np.where(missing, 0.0, middle)
        weight = observation.whitener.matrix(missing)
        off = scale * (apart - middle[..., None, :]) @ np.swapaxes(weight, -1, -2)
        spread = np.swapaxes(off, -1, -2) @ off + np.eye(model.size)
        cross = scale * np.swapaxes(points - mean[..., None, :], -1, -2) @ off
        gain = np.swapaxes(np.linalg.solve(spread, np.swapaxes(cross, -1, -2)), -1, -2)
        whitened = (weight @ innovation[..., None])[..., 0]
        nis = np.einsum("...i,...i->...", whitened, np.linalg.solve(spread, whitened[..., None])[..., 0])
        posterior = symmetric(covariance - gain @ spread @ np.swapaxes(gain, -1, -2))
        return report(mean + (gain @ whitened[..., None])[..., 0], posterior, innovation, nis, missing)


def _points(mean: Array, covariance: Array) -> Array:
    """Return the points (trials, 2 n, n)."""
    columns = math.sqrt(mean.shape[-1]) * np.swapaxes(cholesky(covariance), -1, -2)
    return mean[..., None, :] + np.concatenate([columns, -columns], axis=-2)
