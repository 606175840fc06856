"""The iterated extended Kalman filter as an estimator."""

from dataclasses import dataclass

from quietfix.systems.documented import count, number
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["Iekf"]


@dataclass
class Iekf(EstimatorOptions):
    """Iterated extended Kalman filter."""

    max_iterations: int = count("at most so many linearisations per update; 1 is the EKF", 10)
    tolerance: float = number("stop rule ||x_{j+1} - x_j|| <= tolerance, SI units mixed", 1e-2, above=0)

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        algorithm = IteratedExtendedKalman(self.max_iterations, self.tolerance)
        return KalmanEstimator(name, algorithm, model, motion, start, wiring)
