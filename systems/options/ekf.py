"""The extended Kalman filter as an estimator."""

from dataclasses import dataclass

from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["Ekf"]


@dataclass
class Ekf(EstimatorOptions):
    """Extended Kalman filter: one linearisation, at the prediction."""

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        return KalmanEstimator(name, IteratedExtendedKalman(max_iterations=1), model, motion, start, wiring)
