"""Options of the estimators that are a Gaussian filter behind the common ports."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["FilterOptions", "KalmanOptions"]


@dataclass(frozen=True)
class KalmanOptions(EstimatorOptions):
    """Options that choose a Gaussian filter."""

    @property
    def takes_biases(self) -> bool:
        """See `EstimatorOptions.takes_biases`."""
        return True

    @abstractmethod
    def algorithm(self, motion: MotionModel) -> GaussianFilter:
        """Return the filter, for states that move like that."""

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        return KalmanEstimator(name, self.algorithm(motion), model, motion, start, wiring)


@dataclass(frozen=True)
class FilterOptions(GaussianFilter, KalmanOptions):
    """A Gaussian filter that is its own options: its fields are both, and say what they mean and may be.

    Either the filter is written here, as ``class Mine(FilterOptions)`` with an `update`, or it is one that is there
    already, as ``class Iekf(IteratedExtendedKalman, FilterOptions)``.
    """

    def algorithm(self, motion: MotionModel) -> GaussianFilter:
        """See `KalmanOptions.algorithm`: itself."""
        return self
