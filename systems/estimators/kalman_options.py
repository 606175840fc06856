"""Options of the estimators that are a Gaussian filter behind the common ports."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

from quietfix.systems.documented import documented
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.gated_kalman import GatedKalman
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.filters.recovery.gate import Gate
from quietfix.systems.filters.recovery.heavy_tails import Huber, Student
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["FilterOptions", "KalmanOptions", "kalman_block"]


@dataclass(frozen=True)
class KalmanOptions(EstimatorOptions):
    """Options that choose a Gaussian filter, and what keeps it with its target."""

    gate: Gate | None = documented("leaves out what the prediction makes improbable, for a while; null: nothing", None)
    robust: Huber | Student | None = documented(
        "update for rows with heavy tails, !Huber or !Student; null: none", None
    )
    restart: bool = documented("a trial that is lost begins again from a measurement, where the start does", False)

    @property
    def takes_biases(self) -> bool:
        """See `EstimatorOptions.takes_biases`."""
        return True

    @abstractmethod
    def algorithm(self, motion: MotionModel) -> GaussianFilter:
        """Return the filter, for states that move like that."""

    def filter(self, model: MeasurementModel, motion: MotionModel) -> GaussianFilter:
        """Return the filter with the update that is asked for."""
        algorithm = self.minimiser(model, motion)
        return self.robust.around(algorithm) if isinstance(self.robust, Huber | Student) else algorithm

    def minimiser(self, model: MeasurementModel, motion: MotionModel) -> GaussianFilter:
        """Return the filter with what finds the right minimum of its update, where it looks for one: `algorithm`."""
        return self.algorithm(motion)

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        return kalman_block(name, self.filter(model, motion), model, motion, start, wiring, self)


def kalman_block(
    name: str,
    algorithm: GaussianFilter,
    model: MeasurementModel,
    motion: MotionModel,
    start: Start,
    wiring: Wiring,
    options: Any,
) -> KalmanEstimator:
    """Return the estimator block of a filter, behind a gate and with another beginning where `options` say so.

    Raises
    ------
    ValueError
        If a lost trial cannot begin again.
    """
    block: KalmanEstimator
    # of a user's own class, these may be fields of its own, which mean something else
    if isinstance(options.gate, Gate):
        block = GatedKalman(name, algorithm, model, motion, start, wiring, options.gate)
    else:
        block = KalmanEstimator(name, algorithm, model, motion, start, wiring)
    block.restart_when_lost(options.restart is True, f"estimators.{name}.restart")
    return block


@dataclass(frozen=True)
class FilterOptions(GaussianFilter, KalmanOptions):
    """A Gaussian filter that is its own options: its fields are both, and say what they mean and may be.

    Either the filter is written here, as ``class Mine(FilterOptions)`` with an `update`, or it is one that is there
    already, as ``class Iekf(IteratedExtendedKalman, FilterOptions)``.
    """

    def algorithm(self, motion: MotionModel) -> GaussianFilter:
        """See `KalmanOptions.algorithm`: itself."""
        return self
