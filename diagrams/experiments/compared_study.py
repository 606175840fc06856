"""A study that also notes what its estimators cost."""

from __future__ import annotations

from pydrake.systems.framework import DiagramBuilder

from quietfix.diagrams.assembly.build import Assembly
from quietfix.diagrams.quantities.states import shared
from quietfix.diagrams.statistics.score import Score
from quietfix.diagrams.studies.stopwatch import Stopwatch
from quietfix.diagrams.studies.study import Study

__all__ = ["ComparedStudy"]


class ComparedStudy(Study):
    """A study that also notes what each estimator costs and how many states are scored.

    Parameters
    ----------
    system : str or System
        As of `quietfix.diagrams.run_study`.
    **options
        As of `quietfix.diagrams.studies.study.Study`.

    Attributes
    ----------
    stopwatches : dict of str to Stopwatch
        Of the estimators that run.
    """

    stopwatches: dict[str, Stopwatch]

    def wire(self, trials: int) -> tuple[Assembly, DiagramBuilder, dict[str, Score]]:
        """See `Study.wire`."""
        wired, builder, scores = super().wire(trials)
        self.stopwatches = {name: Stopwatch(block) for name, block in wired.estimators.items()}
        return wired, builder, scores

    @property
    def states(self) -> dict[str, int]:
        """How many states the NEES is about, by estimator."""
        truth = self.probe.truth_names
        return {name: len(shared(block.motion.reported.names, truth)) for name, block in self.probe.estimators.items()}

    @property
    def feedback(self) -> list[str]:
        """Predictions that go back into the measurements, ``estimator -> block``."""
        return [f"{source} -> {target}" for source, target in self.probe.dashed]

    @property
    def costs(self) -> dict[str, float]:
        """Processor time of one step of one trial [us] by estimator, so far."""
        return {name: watch.microseconds for name, watch in self.stopwatches.items()}
