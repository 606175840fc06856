"""Heavy tails: rows that a Gaussian would not have produced get less weight."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.filters.gaussian import GaussianFilter, WrappingFilter
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.square_root import Posterior
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["StudentRows"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StudentRows(WrappingFilter):
    r"""Any Gaussian filter, with the noise of each row scaled as if it were Student's t.

    .. math:: R_{ii} \leftarrow R_{ii}\,\frac{\nu + r_i^2}{\nu + 1}\ \ (\ge R_{ii}), \qquad r_i^2 = \nu_i^2/S_{ii}

    The weight of the scale mixture behind a t distribution with nu degrees of freedom (Lange, Little and Taylor,
    *Robust statistical modeling using the t distribution*, J. Am. Stat. Assoc. 84 (1989) 881), taken at the prediction.
    The pull of an outlier falls as 1/r beyond sqrt(nu); it is never quite zero, so that a filter that is wrong itself
    can come back, which a gate does not allow.

    Parameters
    ----------
    algorithm : GaussianFilter
        The filter.
    freedom : float
        nu, > 0; infinitely many are the Gaussian.
    rows : sequence of int, optional
        Which rows have tails; by default all.
    """

    algorithm: GaussianFilter = field(default_factory=IteratedExtendedKalman)
    freedom: float = 4.0
    rows: Sequence[int] | None = None

    def __post_init__(self) -> None:
        """Check the arguments."""
        if math.isnan(self.freedom) or self.freedom <= 0:
            raise ValueError(f"freedom: {self.freedom} is not allowed; degrees of freedom > 0")

    def update(self, mean: Array, covariance: Array, observation: Observation, model: MeasurementModel) -> Posterior:
        """See `GaussianFilter.update`."""
        if math.isinf(self.freedom):
            return self.algorithm.update(mean, covariance, observation, model)
        value, jacobian = model.linearize(mean, observation.platforms)
        innovation = model.residual(observation.value, value)
        noise = np.broadcast_to(observation.noise_covariance, (*innovation.shape, innovation.shape[-1]))
        own = np.einsum("...ij,...jk,...ik->...i", jacobian, covariance, jacobian)
        ratio = innovation**2 / (own + np.einsum("...ii->...i", noise))
        # A missing row is left out by the filter itself; its weight only has to be a number.
        scale = np.where(np.isfinite(ratio), np.maximum((self.freedom + ratio) / (self.freedom + 1), 1.0), 1.0)
        if self.rows is not None:
            kept = np.ones(innovation.shape[-1], dtype=bool)
            kept[list(self.rows)] = False
            scale = np.where(kept, 1.0, scale)
        root = np.sqrt(scale)
        weighted = observation.with_noise(noise * root[..., :, None] * root[..., None, :])
        return self.algorithm.update(mean, covariance, weighted, model)
