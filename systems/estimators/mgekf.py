"""The modified gain extended Kalman filter as an estimator."""

from dataclasses import dataclass

from systems.estimators.base import Estimator, Wiring
from systems.estimators.kalman import KalmanEstimator
from systems.estimators.options import EstimatorOptions
from systems.estimators.start import Start
from systems.filters.modified_gain import ModifiedGainKalman
from systems.measurement.base import MeasurementModel
from systems.measurement.bearing import Bearing
from systems.motion.base import MotionModel

__all__ = ["Mgekf"]


@dataclass
class Mgekf(EstimatorOptions):
    """Modified gain extended Kalman filter, for bearings."""

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        if not isinstance(model, Bearing):
            raise ValueError(f"{name}: a modified gain is known for bearings only, not for {', '.join(model.names)}")
        return KalmanEstimator(name, ModifiedGainKalman(), model, motion, start, wiring)
