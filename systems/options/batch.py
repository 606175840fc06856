"""Maximum a posteriori over a window as an estimator."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.systems.batch.estimator import BatchEstimator
from quietfix.systems.batch.solving import Rule
from quietfix.systems.documented import count, number
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.options import EstimatorOptions, refuse_considered
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["Batch"]


@dataclass(frozen=True)
class Batch(EstimatorOptions):
    """The most probable path through a window of epochs, process noise and all, by Levenberg-Marquardt."""

    epochs: int = count("how many epochs the window has", 10, at_most=1000)
    max_iterations: int = count("steps at most per epoch", 20)
    tolerance: float = number("a step that gains less than this, in squared sigmas, is the last one", 1e-6, above=0)
    edit_sigmas: float | None = number(
        "rows further off the path than so many sigmas of their noise are left out; null: none", None, above=0
    )

    @property
    def takes_biases(self) -> bool:
        """See `EstimatorOptions.takes_biases`."""
        return True

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        refuse_considered(name, motion, "a window")
        rule = Rule(self.max_iterations, self.tolerance, self.edit_sigmas)
        return BatchEstimator(name, self.epochs, rule, model, motion, start, wiring)
