"""The extended Kalman filter as an estimator."""

from dataclasses import dataclass

from systems.estimators.base import Estimator
from systems.estimators.kalman import KalmanEstimator
from systems.estimators.options import EstimatorOptions
from systems.estimators.wiring import Wiring
from systems.filters.iterated_extended import IteratedExtendedKalman
from systems.measurement.base import MeasurementModel
from systems.motion.base import MotionModel
from systems.starts.start import Start

__all__ = ["Ekf"]


@dataclass
class Ekf(EstimatorOptions):
    """Extended Kalman filter: one linearisation, at the prediction."""

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        return KalmanEstimator(name, IteratedExtendedKalman(max_iterations=1), model, motion, start, wiring)
