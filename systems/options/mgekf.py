"""The modified gain extended Kalman filter as an estimator."""

from dataclasses import dataclass

from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.modified_gain import ModifiedGainKalman
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["Mgekf"]


@dataclass
class Mgekf(EstimatorOptions):
    """Modified gain extended Kalman filter; for measurements other than bearings it is the EKF."""

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        return KalmanEstimator(name, ModifiedGainKalman(), model, motion, start, wiring)
