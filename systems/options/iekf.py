"""The iterated extended Kalman filter as an estimator."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.systems.documented import documented
from quietfix.systems.estimators.kalman_options import FilterOptions
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.recovery.second_minimum import SecondMinimum
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel

__all__ = ["Iekf"]


@dataclass(frozen=True)
class Iekf(IteratedExtendedKalman, FilterOptions):
    """Iterated extended Kalman filter."""

    retry: bool = documented(
        "an update that ends improbably is tried again from elsewhere, where an epoch has as many rows as states", False
    )

    def minimiser(self, model: MeasurementModel, motion: MotionModel) -> GaussianFilter:
        """See `KalmanOptions.minimiser`."""
        algorithm = self.algorithm(motion)
        return SecondMinimum(algorithm) if self.retry and model.size >= motion.size else algorithm
