"""A study that also notes what its estimators cost."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder

from quietfix.diagrams.assembly.build import Assembly
from quietfix.diagrams.chunks.jobs import Tell
from quietfix.diagrams.chunks.part import Part
from quietfix.diagrams.quantities.states import shared
from quietfix.diagrams.statistics.score import Score
from quietfix.diagrams.studies.stopwatch import Stopwatch
from quietfix.diagrams.studies.study import Study

__all__ = ["COST", "ComparedStudy"]

Array = NDArray[np.float64]

COST = "cost"
"""Name of what a part has cost: seconds, and steps times trials, by estimator."""


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

    def parts(
        self,
        progress: bool | Tell = False,
        first: int = 0,
        count: int | None = None,
        numbers: Collection[int] | None = None,
        width: int | None = None,
    ) -> Iterator[Part]:
        """See `Study.parts`; each part says what it has cost."""
        before: dict[int, Array] = {}
        for part in super().parts(progress, first, count, numbers, width):
            spent = []
            for watch in self.stopwatches.values():
                spent.append(watch.spent - before.get(id(watch), 0.0))
                before[id(watch)] = watch.spent
            yield replace(part, also={**part.also, COST: np.array(spent).reshape(-1, 2)})
            del part

    def costs_of(self, spent: Iterable[Array]) -> dict[str, float]:
        """Return processor time of one step of one trial [us] by estimator, from what is said by the parts."""
        total = np.sum([np.zeros((len(self.states), 2)), *spent], axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            return dict(zip(self.states, (1e6 * total[:, 0] / total[:, 1]).tolist(), strict=True))

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
