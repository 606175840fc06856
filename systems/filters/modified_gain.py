"""The modified gain extended Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from systems.filters.gaussian import GaussianFilter
from systems.filters.linear_algebra import cholesky, symmetric
from systems.filters.square_root import Gains, Posterior, statistic
from systems.filters.whitening import Whitener, missing_rows
from systems.measurement.base import MeasurementModel
from systems.measurement.bearing import Bearing

__all__ = ["ModifiedGainKalman"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ModifiedGainKalman(GaussianFilter):
    r"""EKF gain; the covariance by the gain that would make the linear relation exact.

    .. math:: K = P H^T (H P H^T + R)^{-1}, \qquad \hat x^+ = \hat x + K\,[z - h(\hat x)], \qquad
              P^+ = (I - K g)\,P\,(I - K g)^T + K R K^T

    H is the Jacobian at the prediction, g the model's `secant` at the measurement. Galkowski and Islam, *An alternate
    derivation of the modified gain function of Song and Speyer*, IEEE Trans. Automatic Control 36 (1991) 1323-1326.
    Joseph's form keeps P positive definite whatever g.
    """

    def update(
        self,
        mean: Array,
        covariance: Array,
        measurement: Array,
        platforms: Array,
        model: MeasurementModel,
        whitener: Whitener,
    ) -> Posterior:
        """See `GaussianFilter.update`."""
        if not isinstance(model, Bearing):
            raise ValueError(f"a modified gain filter needs bearings; {', '.join(model.names)} has no modified gain")
        value, jacobian = model.linearize(mean, platforms)
        secant = model.secant(measurement, mean, platforms)
        innovation = model.residual(measurement, value)
        missing = missing_rows(innovation, jacobian.sum(axis=-1), secant.sum(axis=-1))
        if missing is not None:
            innovation = np.where(missing, 0.0, innovation)
            jacobian, secant = (np.where(missing[..., None], 0.0, rows) for rows in (jacobian, secant))
        w = whitener.matrix(missing)
        root = cholesky(covariance)
        rows = w @ (jacobian @ root)
        whitened = np.einsum("...ij,...j->...i", w, innovation)
        gains = Gains(root, rows)
        # The gain of whitened residuals, column by column: K W^-1 = L (I + Y^T Y)^-1 Y^T.
        unit = np.broadcast_to(np.eye(model.size), (*mean.shape[:-1], model.size, model.size))
        gain = np.stack([gains.correction(unit[..., i]) for i in range(model.size)], axis=-1)
        kept = (np.eye(mean.shape[-1]) - gain @ (w @ secant)) @ root
        spread = symmetric(kept @ np.swapaxes(kept, -1, -2) + gain @ np.swapaxes(gain, -1, -2))
        nis = statistic(rows, whitened)
        if missing is None:
            used = np.full(mean.shape[0], float(model.size))
        else:
            innovation = np.where(missing, np.nan, innovation)
            used = np.count_nonzero(~missing, axis=-1).astype(float)
            nis = np.where(used > 0, nis, np.nan)
        return Posterior(mean + gains.correction(whitened), spread, innovation, nis, used)
