"""The iterated extended Kalman filter, once per hypothesis about the phase integers, as an estimator."""

from dataclasses import dataclass
from typing import ClassVar

from quietfix.systems.documented import count, number
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.hypothesis_bank import HypothesisBank, phases_of
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.options.iekf import Iekf
from quietfix.systems.starts.hypotheses_start import HypothesesStart
from quietfix.systems.starts.known_height_start import KnownHeightStart
from quietfix.systems.starts.start import Start

__all__ = ["IekfHypotheses"]


@dataclass(frozen=True)
class IekfHypotheses(Iekf):
    """Iterated extended Kalman filters for all phase integers that the start allows, until one explains the data.

    It resolves wrapped phases itself. Without phases, or with another start than two TDOAs and an assumed height,
    there is one hypothesis: the plain filter.
    """

    resolves_phases: ClassVar[bool] = True

    hypotheses: int = count("most hypotheses kept in a trial", 24)
    least_weight: float = number("a hypothesis with less probability than this is dropped", 1e-5, above=0, at_most=0.5)

    @property
    def takes_biases(self) -> bool:
        """See `EstimatorOptions.takes_biases`: not yet, for its start does not say what biases do to it."""
        return False

    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
        if self.gate is not None:
            raise ValueError(
                f"estimators.{name}.gate: it is not allowed here; null, for hypotheses are weighed by what they refuse "
                "(robust works)"
            )
        phases = phases_of(model)
        if phases and isinstance(start, KnownHeightStart):
            start = HypothesesStart(
                start.tdoa,
                Stack(phases),
                wiring.stream,
                start.sigma_height,
                start.sigma_velocity,
                start.sigma_satellite,
                self.hypotheses,
            )
        bank = HypothesisBank(name, self.filter(model, motion), model, motion, start, wiring, self.least_weight)
        bank.restart_when_lost(self.restart, f"estimators.{name}.restart")
        return bank
