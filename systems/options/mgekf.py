"""The modified gain extended Kalman filter as an estimator."""

from dataclasses import dataclass

from systems.estimators.base import Estimator
from systems.estimators.kalman import KalmanEstimator
from systems.estimators.options import EstimatorOptions
from systems.estimators.wiring import Wiring
from systems.filters.modified_gain import ModifiedGainKalman
from systems.measurement.base import MeasurementModel
from systems.motion.base import MotionModel
from systems.starts.start import Start

__all__ = ["Mgekf"]


@dataclass
class Mgekf(EstimatorOptions):
    """Modified gain extended Kalman filter; for measurements other than bearings it is the EKF."""

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        return KalmanEstimator(name, ModifiedGainKalman(), model, motion, start, wiring)
