"""The iterated extended Kalman filter as an estimator."""

from dataclasses import dataclass

from systems.documented import count, number
from systems.estimators.base import Estimator
from systems.estimators.kalman import KalmanEstimator
from systems.estimators.options import EstimatorOptions
from systems.estimators.wiring import Wiring
from systems.filters.iterated_extended import IteratedExtendedKalman
from systems.measurement.base import MeasurementModel
from systems.motion.base import MotionModel
from systems.starts.start import Start

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
