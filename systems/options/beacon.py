"""Unscented filters for stations that share a bias: without a bias state, and with a monitor for its jumps."""

from dataclasses import dataclass
from typing import ClassVar

from quietfix.systems.documented import number
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.common_mode import CommonModeMonitor
from quietfix.systems.filters.unscented import UnscentedKalman
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.options.ukf import Ukf
from quietfix.systems.starts.start import Start

__all__ = ["UkfMonitored", "UkfUnaugmented"]


@dataclass
class UkfUnaugmented(Ukf):
    """Unscented Kalman filter that knows of no bias (experiment 1 of the beacon rocket's paper)."""

    estimates_bias: ClassVar[bool] = False


@dataclass
class UkfMonitored(Ukf):
    """Unscented Kalman filter with a monitor for jumps of the bias that all rows share (its last state)."""

    switch: float = number("a common jump is declared above this likelihood ratio", 100.0, above=0)
    gate: float = number("a sample whose common-mode-free NIS is above this is left out", 1e6, above=0)
    reset_sigma_mps: float = number("standard deviation of the bias after a jump [m/s]", 1e4, above=0)

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        inner = UnscentedKalman(self.alpha, self.beta, self.kappa)
        monitor = CommonModeMonitor(inner, motion.size - 1, self.switch, self.gate, self.reset_sigma_mps)
        return KalmanEstimator(name, monitor, model, motion, start, wiring)
