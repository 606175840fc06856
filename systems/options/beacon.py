"""Unscented filters for stations that share a bias: without a bias state, and with a monitor for its jumps."""

from dataclasses import dataclass
from typing import ClassVar

from systems.documented import number
from systems.estimators.base import Estimator
from systems.estimators.kalman import KalmanEstimator
from systems.estimators.wiring import Wiring
from systems.filters.common_mode import CommonModeMonitor
from systems.filters.unscented import UnscentedKalman
from systems.measurement.base import MeasurementModel
from systems.motion.base import MotionModel
from systems.options.ukf import Ukf
from systems.starts.start import Start

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
