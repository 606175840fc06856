"""The unscented Kalman filter as an estimator."""

from dataclasses import dataclass

from quietfix.systems.documented import number
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.unscented import UnscentedKalman
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["Ukf"]


@dataclass
class Ukf(EstimatorOptions):
    """Unscented Kalman filter; the defaults are the cubature rule."""

    alpha: float = number("spread of the sigma points", 1.0, above=0)
    beta: float = number("extra weight of the centre in covariances (2: Gaussian)", 0.0)
    kappa: float = number("secondary scaling; n + kappa > 0", 0.0)

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        if motion.size + self.kappa <= 0:
            raise ValueError(
                f"estimators.{name}.kappa: {self.kappa:g} is not allowed; > -{motion.size}, minus the number of states"
            )
        algorithm = UnscentedKalman(self.alpha, self.beta, self.kappa)
        return KalmanEstimator(name, algorithm, model, motion, start, wiring)
