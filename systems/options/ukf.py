"""The unscented Kalman filter as an estimator."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.kalman_options import FilterOptions
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.unscented import UnscentedKalman
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["Ukf"]


@dataclass(frozen=True)
class Ukf(UnscentedKalman, FilterOptions):
    """Unscented Kalman filter; the defaults are the cubature rule."""

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """See `KalmanOptions.make`; the number of states is known only now."""
        if motion.size + self.kappa <= 0:
            raise ValueError(
                f"estimators.{name}.kappa: {self.kappa:g} is not allowed; > -{motion.size}, minus the number of states"
            )
        return super().make(name, model, motion, start, wiring)
