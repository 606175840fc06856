"""A smoother of any Kalman-type filter as an estimator."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.systems.documented import documented, number
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.estimators.kalman_options import KalmanOptions
from quietfix.systems.estimators.options import EstimatorOptions, refuse_considered
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.options.beacon import UkfMonitored, UkfUnaugmented
from quietfix.systems.options.custom import Custom
from quietfix.systems.options.ekf import Ekf
from quietfix.systems.options.iekf import Iekf
from quietfix.systems.options.mgekf import Mgekf
from quietfix.systems.options.ukf import Ukf
from quietfix.systems.registry import object_at
from quietfix.systems.smoothing.smoother import Smoother
from quietfix.systems.starts.start import Start

__all__ = ["Smoothed", "can_be_smoothed"]


@dataclass(frozen=True)
class Smoothed(EstimatorOptions):
    r"""Smoother (Rauch-Tung-Striebel) of a Kalman-type filter: what it knows of a state with later measurements too.

    It looks back when a run is over; until then its ports carry what the filter knows. Where a gate has opened, or a
    trial has begun again, what was believed before was wrong: no later measurement says anything of that.

    .. math:: x^s = x + G\,(x^s_+ - x^-_+), \qquad P^s = P + G\,(P^s_+ - P^-_+)\,G^T, \qquad G = P A^T (P^-_+)^{-1}

    Rauch, Tung and Striebel, *Maximum likelihood estimates of linear dynamic systems*, AIAA J. 3 (1965) 1445-1450.
    """

    filter: Iekf | Ekf | Ukf | Mgekf | UkfUnaugmented | UkfMonitored | Custom = documented(
        "the filter that goes before", factory=Iekf
    )
    lag_s: float | None = number(
        "measurements count until so long after an epoch [s]; null: all of the run", None, at_least=0
    )

    @property
    def plain(self) -> EstimatorOptions:
        """See `EstimatorOptions.plain`."""
        return self.filter.plain

    @property
    def takes_biases(self) -> bool:
        """See `EstimatorOptions.takes_biases`."""
        return self.filter.takes_biases

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the filter's block, which knows its smoother.

        Raises
        ------
        ValueError
            For measurements of its own, and for a filter whose belief is no mean and covariance of the motion's state.
        """
        if self.measurements:
            raise ValueError(
                f"estimators.{name}.measurements: {self.measurements} is not allowed; they are those of its filter"
            )
        refuse_considered(name, motion, "a smoother")
        block = self.filter.make(name, model, motion, start, wiring)
        if not isinstance(block, KalmanEstimator) or not block.plain:
            raise ValueError(
                f"estimators.{name}.filter: {type(self.filter).__name__} is not allowed; a filter of one mean and "
                "covariance"
            )
        block.smoother = Smoother(block.algorithm, block.motion, self.lag_s)
        block.causal = False
        return block


def can_be_smoothed(options: EstimatorOptions) -> bool:
    """Return whether `Smoothed` takes such a filter."""
    if isinstance(options, Custom):
        kind = object_at(options.class_)
        return isinstance(kind, type) and issubclass(kind, GaussianFilter)
    return isinstance(options, KalmanOptions)
