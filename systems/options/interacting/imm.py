"""The interacting multiple model estimator."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from quietfix.systems.clocks import first_ticks
from quietfix.systems.documented import documented
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.kalman import KalmanEstimator
from quietfix.systems.estimators.options import EstimatorOptions, refuse_considered
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.options import custom
from quietfix.systems.options.ekf import Ekf
from quietfix.systems.options.iekf import Iekf
from quietfix.systems.options.interacting.estimator import InteractingModels
from quietfix.systems.options.interacting.models import AsBelieved, Custom, model_of
from quietfix.systems.options.interacting.transitions import Matrix, Sojourn
from quietfix.systems.options.mgekf import Mgekf
from quietfix.systems.options.motions import ConstantVelocity, CoordinatedTurn, WhiteNoiseAcceleration
from quietfix.systems.options.ukf import Ukf
from quietfix.systems.starts.start import Start

__all__ = ["Imm"]

_TICKS = 1000  # of a clock, whose steps are looked at before the run begins
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


@dataclass(frozen=True)
class Imm(EstimatorOptions):
    """Interacting multiple models: a Gaussian filter for each of several motions, between which the target changes."""

    models: dict[str, WhiteNoiseAcceleration | ConstantVelocity | CoordinatedTurn | AsBelieved | Custom] = documented(
        "the motions, by names of one's own; all of the same states", factory=dict
    )
    transitions: Sojourn | Matrix = documented("how one is followed by another", factory=Sojourn)
    initial: dict[str, float] = documented(
        "probability of each model at the start, by its name; none: as in the long run", factory=dict
    )
    filter: Ekf | Iekf | Ukf | Mgekf | custom.Custom = documented("the filter of each model", factory=Ekf)
    restart: bool = documented("a trial that is lost begins again from a measurement, where the start does", False)

    @property
    def takes_biases(self) -> bool:
        """See `EstimatorOptions.takes_biases`."""
        return True

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        where = f"estimators.{name}"
        refuse_considered(name, motion, "!Imm")
        if not self.models:
            raise ValueError(f"{where}.models: none is given; at least one is needed")
        for own in self.models:
            if not _NAME.fullmatch(own):
                raise ValueError(
                    f"{where}.models: the name {own!r} is not allowed; letters, digits and _, a letter first"
                )
        motions = {
            own: model_of(field, motion, wiring.level, f"{where}.models.{own}") for own, field in self.models.items()
        }
        algorithms = [self._algorithm(name, model, one, start, wiring) for one in motions.values()]
        chain = self.transitions.chain(list(motions), f"{where}.transitions")
        ticks = first_ticks(wiring.clock, _TICKS)
        for step in np.unique(np.diff(ticks).round(9)) if chain.step else ():
            try:
                chain.over(float(step))
            except ValueError as error:
                raise ValueError(f"{where}.{error}") from error
        initial = self._initial(where) if self.initial else chain.long_run()
        block = InteractingModels(name, algorithms[0], model, motion, start, wiring, motions, chain, initial)
        block.restart_when_lost(self.restart, f"{where}.restart")
        return block

    def _initial(self, where: str) -> np.ndarray:
        for own, value in self.initial.items():
            if own not in self.models or not 0 <= value <= 1:
                raise ValueError(
                    f"{where}.initial.{own}: {value:g} is not allowed; >= 0 and <= 1, of {', '.join(self.models)}"
                )
        total = sum(self.initial.values())
        if abs(total - 1) > 1e-9:
            raise ValueError(f"{where}.initial: they sum to {total:.10g}; 1 is needed")
        return np.array([self.initial.get(own, 0.0) for own in self.models])

    def _algorithm(
        self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring
    ) -> GaussianFilter:
        """Return the filter that the options within make, with all that they put around it."""
        if self.filter.measurements:
            raise ValueError(f"estimators.{name}.filter.measurements: not allowed here; estimators.{name}.measurements")
        block = self.filter.make(name, model, motion, start, wiring)
        if type(block) is not KalmanEstimator or block.may_begin_again:
            raise ValueError(
                f"estimators.{name}.filter: {type(self.filter).__name__} is not allowed as it stands here; a filter of "
                "mean and covariance alone, without a gate or a beginning of its own"
            )
        return block.algorithm
