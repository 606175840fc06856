"""Measurements with tails heavier than a Gaussian's: what a user chooses, and Huber's update."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.documented import number
from quietfix.systems.filters.gaussian import GaussianFilter, WrappingFilter
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.recovery.screening import screen
from quietfix.systems.filters.robust import StudentRows
from quietfix.systems.filters.square_root import Posterior
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["Huber", "HuberRows", "Student"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class HuberRows(WrappingFilter):
    r"""Any Gaussian filter, with no row pulling harder than one that is `threshold` sigmas of its noise off.

    Huber's loss of a row, quadratic up to k sigmas and linear beyond, is a Gaussian with the variance
    :math:`R' = R\,|e|/(k \sqrt R)` at the residual e that is left (iteratively reweighted least squares; Huber, *Robust
    Statistics*, 1981, ch. 7; Karlgaard and Schaub, *Huber-based divided difference filtering*, J. Guidance 30 (2007)
    885). For one row with the predicted innovation :math:`\nu` and :math:`p = (H P H^T)_{ii}`, the residual is
    :math:`e = \nu R'/(p + R')`, and the two give in closed form

    .. math:: R' = \max\left(R,\ \frac{\sqrt R\,|\nu|}{k} - p\right),

    which is what is done, row by row, at the prediction. Correlations of the noise stay as they are.

    Parameters
    ----------
    algorithm : GaussianFilter
        The filter.
    threshold : float
        k, > 0.
    """

    algorithm: GaussianFilter = field(default_factory=IteratedExtendedKalman)
    threshold: float = 1.345

    def __post_init__(self) -> None:
        """Check the arguments."""
        if math.isnan(self.threshold) or self.threshold <= 0:
            raise ValueError(f"threshold: {self.threshold} is not allowed; sigmas > 0")

    def update(self, mean: Array, covariance: Array, observation: Observation, model: MeasurementModel) -> Posterior:
        """See `GaussianFilter.update`."""
        seen = screen(mean, covariance, observation, model)
        there = np.isfinite(seen.innovation)
        noise = np.where(there, seen.noise_variances, 1.0)
        wider = np.sqrt(noise) * np.abs(np.where(there, seen.innovation, 0.0)) / self.threshold - seen.own_variances
        scale = np.sqrt(np.maximum(wider / noise, 1.0))
        if (scale > 1).any():
            observation = observation.with_noise(seen.noise * scale[..., :, None] * scale[..., None, :])
        return self.algorithm.update(mean, covariance, observation, model)


@dataclass(frozen=True)
class Huber:
    """Huber's update: beyond `threshold` sigmas of its noise a row pulls no harder, however far off it is."""

    threshold: float = number("sigmas of a row beyond which it pulls no harder", 1.345, above=0)

    def around(self, algorithm: GaussianFilter) -> GaussianFilter:
        """Return the filter with this update."""
        return HuberRows(algorithm, self.threshold)


@dataclass(frozen=True)
class Student:
    """Student's update: beyond sqrt(`freedom`) sigmas of its innovation a row pulls the less the further off it is."""

    freedom: float = number("degrees of freedom of the rows' noise; the fewer the heavier its tails", 4.0, above=0)

    def around(self, algorithm: GaussianFilter) -> GaussianFilter:
        """Return the filter with this update."""
        return StudentRows(algorithm, self.freedom)
