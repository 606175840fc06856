"""The modified gain extended Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.filters.observation import Observation, linearised
from quietfix.systems.filters.square_root import Gains, Posterior, report
from quietfix.systems.linear_algebra import cholesky
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["ModifiedGainKalman"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ModifiedGainKalman(GaussianFilter):
    r"""EKF gain; the covariance by the gain that would make the linear relation exact.

    .. math:: K = P H^T S^{-1}, \quad S = H P H^T + R, \qquad \hat x^+ = \hat x + K\,[z - h(\hat x)], \qquad
              P^+ = (I - K g)\,P\,(I - K g)^T + K R K^T

    H is the Jacobian at the prediction, g the model's `modified_gain` at the measurement. Galkowski and Islam, *An
    alternate derivation of the modified gain function of Song and Speyer*, IEEE Trans. Automatic Control 36 (1991)
    1323-1326.

    Notes
    -----
    With D = g - H and the covariance :math:`A A^T` of the EKF,
    :math:`P^+ = (I - K D) A A^T (I - K D)^T + (K D K)\,S\,(K D K)^T`: definite whatever g, without forming differences
    of a wide prior, and the EKF's where g = H.
    """

    def update(self, mean: Array, covariance: Array, observation: Observation, model: MeasurementModel) -> Posterior:
        """See `GaussianFilter.update`."""
        innovation, jacobian, weight, missing = linearised(observation, model, mean)
        modified_gain = model.modified_gain(observation.value, mean, observation.platforms)
        if missing is not None:
            modified_gain = np.where(missing[..., None], 0.0, modified_gain)
        root = cholesky(covariance)
        gains = Gains(root, weight @ (jacobian @ root))
        step, nis = gains.update((weight @ innovation[..., None])[..., 0])
        posterior = self._covariance(gains, weight @ (modified_gain - jacobian))
        return report(mean + step, posterior, innovation, nis, missing)

    @staticmethod
    def _covariance(gains: Gains, difference: Array) -> Array:
        """Return P+; `difference` is D, whitened (trials, m, n): where it is 0, that of the EKF."""
        same: NDArray[np.bool_] = ~np.any(difference, axis=(-1, -2))
        if same.all():
            return gains.covariance()
        m = difference.shape[-2]
        unit = np.broadcast_to(np.eye(m), (*difference.shape[:-2], m, m))
        gain = np.stack([gains.correction(unit[..., i]) for i in range(m)], axis=-1)
        spread = np.eye(m) + gains.rows @ np.swapaxes(gains.rows, -1, -2)
        root = gains.root()
        half = np.concatenate(
            [root - gain @ (difference @ root), gain @ (difference @ gain) @ np.linalg.cholesky(spread)], axis=-1
        )
        modified: Array = half @ np.swapaxes(half, -1, -2)
        return np.where(same[:, None, None], gains.covariance(), modified) if same.any() else modified
