"""Unscented filters for stations that share a bias: without a bias state, and with a monitor for its jumps."""

from dataclasses import dataclass
from typing import ClassVar

from quietfix.systems.documented import number
from quietfix.systems.filters.common_mode import CommonModeMonitor
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.options.ukf import Ukf

__all__ = ["UkfMonitored", "UkfUnaugmented"]


@dataclass(frozen=True)
class UkfUnaugmented(Ukf):
    """Unscented Kalman filter that knows of no bias (experiment 1 of the beacon rocket's paper)."""

    estimates_bias: ClassVar[bool] = False


@dataclass(frozen=True)
class UkfMonitored(Ukf):
    """Unscented Kalman filter with a monitor for jumps of the bias that all rows share (its last state)."""

    switch: float = number("a common jump is declared above this likelihood ratio", 100.0, above=0)
    leave_out: float = number("a sample whose common-mode-free NIS is above this is left out", 1e6, above=0)
    reset_sigma_mps: float = number("standard deviation of the bias after a jump [m/s]", 1e4, above=0)

    def algorithm(self, motion: MotionModel) -> GaussianFilter:
        """See `KalmanOptions.algorithm`."""
        return CommonModeMonitor(
            super().algorithm(motion), motion.reported.size - 1, self.switch, self.leave_out, self.reset_sigma_mps
        )
