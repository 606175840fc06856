"""The extended Kalman filter as an estimator."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.systems.estimators.kalman_options import KalmanOptions
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.motion.base import MotionModel

__all__ = ["Ekf"]


@dataclass(frozen=True)
class Ekf(KalmanOptions):
    r"""Extended Kalman filter: one linearisation, at the prediction.

    .. math:: K = P^- H^T (H P^- H^T + R)^{-1}, \qquad x = x^- + K\,[z - h(x^-)], \qquad P = (I - K H) P^-
    """

    def algorithm(self, motion: MotionModel) -> GaussianFilter:
        """See `KalmanOptions.algorithm`."""
        return IteratedExtendedKalman(max_iterations=1)
