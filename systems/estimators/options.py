"""What the options of every estimator have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from quietfix.systems.documented import documented
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["EstimatorOptions", "refuse_considered"]


def refuse_considered(name: str, motion: MotionModel, what: str) -> None:
    """Refuse biases that are only considered.

    Raises
    ------
    ValueError
        Naming the estimator, what it is, and the biases.
    """
    if motion.considered:
        kept = [motion.names[i] for i in motion.considered]
        raise ValueError(
            f"estimators.{name}: {what} is not allowed with biases that are considered ({', '.join(kept)}); mode: "
            "estimate"
        )


@dataclass(frozen=True)
class EstimatorOptions(ABC):
    """Options of an estimator as a user writes them; the class name is the YAML tag.

    Attributes
    ----------
    resolves_phases : bool
        True where the estimator takes wrapped phases as they come and needs no resolver before it.
    """

    resolves_phases: ClassVar[bool] = False

    measurements: list[str] = documented(
        "kinds of measurement that it uses, such as [tdoa, fdoa, phase_a]; empty: all", factory=list
    )

    @property
    def plain(self) -> EstimatorOptions:
        """The options that a system looks at: those of the filter within, where one only looks at what that tells."""
        return self

    @property
    def takes_biases(self) -> bool:
        """Whether biases may stand behind the target's state, some of them only considered: of Gaussian filters."""
        return False

    @abstractmethod
    def make(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> Estimator:
        """Return the estimator block."""
