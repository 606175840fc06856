"""A study that grows: trials n, n+1 ... continue it, since noise is a pure function of the trial's number."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.assembly.lineup import estimator_key
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.diagrams.studies.study import Study
from quietfix.diagrams.verification.metrics import RmseRatio
from quietfix.diagrams.verification.specification import Requirement, Specification
from quietfix.diagrams.verification.study_view import StudyFacts, StudyView

__all__ = ["GrowingStudy"]

Array = NDArray[np.float64]


class GrowingStudy:
    """The trials of one case, as many as have been asked for; of each, only what its requirements take is kept.

    Parameters
    ----------
    specification : Specification
        The file.
    path : Path
        Where it is; a scenario file is relative to it.
    case : str
        Name of the case, empty if the file has none.
    looks : sequence of int
        The numbers of trials that will be asked for.
    seed : int
        Seed of all noise.
    progress : bool
        Show a progress bar.
    threads : int
        As of `quietfix.diagrams.run_study`.

    Raises
    ------
    UserError
        If it cannot be built, or a requirement does not fit the system or the run.
    """

    def __init__(
        self,
        specification: Specification,
        path: Path,
        case: str,
        looks: Sequence[int],
        seed: int,
        progress: bool = False,
        threads: int = 1,
    ) -> None:
        self.requirements = [r for r in specification.requirements if r.case == case]
        self.looks = tuple(looks)
        self._progress = progress
        options = _options(specification, path, case, self.requirements)
        self._study = Study(**options, trials=self.looks[-1], seed=seed, threads=threads)
        self.run = StudyFacts(self._study.probe)
        self.version = str(self._study.attributes()["version"])
        for i, requirement in enumerate(specification.requirements):
            if requirement.case == case:
                self._check(requirement, f"requirements.{i}")
        self._samples: list[list[Array]] = []
        self._squares: list[list[float | None]] = []

    def _check(self, requirement: Requirement, where: str) -> None:
        assert requirement.confidence is not None
        choose(f"{where}.estimator", requirement.estimator, self.run.states)
        requirement.measured.check(self.run, requirement.estimator, f"{where}.metric")
        statistic, limit = requirement.measured.statistic(self.run), requirement.limit
        tail = limit.tail(requirement.confidence, len(self.looks))
        sides = [upper for upper, side in ((False, limit.at_least), (True, limit.at_most)) if side is not None]
        needed = max(statistic.floor, *(statistic.fewest(tail, upper) for upper in sides))
        if self.looks[-1] < needed:
            raise UserError(
                f"{where}: {self.looks[-1]} trials at the last look are not allowed; "
                f"its confidence and {len(self.looks)} looks need at least {needed} to decide it"
            )

    # ---- growing

    def _grow(self) -> None:
        """Run the trials up to the next look."""
        k = len(self._samples)
        first = self.looks[k - 1] if k else 0
        parts: list[list[Array]] = [[] for _ in self.requirements]
        squares: list[float | None] = []
        for chunk in self._study.chunks(self._progress, first, self.looks[k] - first):
            view = StudyView(chunk)
            for r, found in zip(self.requirements, parts, strict=True):
                found.append(r.measured.reduce(view, r.estimator, self.run))
            if chunk["trial"].values[-1] == self.looks[k] - 1:  # the last chunk carries the bounds
                squares = [r.measured.bound_square(chunk, r.estimator, self.run) for r in self.requirements]
        self._samples.append([np.concatenate(found) for found in parts])
        self._squares.append(squares)

    def samples(self, requirement: Requirement, trials: int) -> Array:
        """Return the samples (n, columns) of the first `trials` trials, without those that have none.

        Raises
        ------
        UserError
            If no trial has one, or the system has no such bound.
        """
        place = next(i for i, r in enumerate(self.requirements) if r is requirement)
        segments = self.looks.index(trials) + 1
        while len(self._samples) < segments:
            self._grow()
        values = np.concatenate([segment[place] for segment in self._samples[:segments]])
        kept = values[~np.isnan(values).any(axis=-1)]
        what = f"requirement {requirement.name!r}: estimator {requirement.estimator}"
        if not kept.size:
            raise UserError(
                f"{what} has no number for {requirement.measured.title()}; another metric or time is needed"
            )
        square = self._bound(place, segments)
        if square is None:
            return kept
        if not math.isfinite(square) or square <= 0:
            raise UserError(f"{what} has no such bound in this system; an RMSE with a limit of its own is needed")
        return np.concatenate([kept, np.full_like(kept, square)], axis=-1)

    def _bound(self, place: int, segments: int) -> float | None:
        """Return the squared bound over the first looks' trials."""
        parts = [row[place] for row in self._squares[:segments]]
        if any(part is None for part in parts):
            return None
        counts = np.diff([0, *self.looks[:segments]])
        return float(np.average(np.array(parts, dtype=float), weights=counts))


def _options(
    specification: Specification, path: Path, case: str, requirements: Sequence[Requirement]
) -> dict[str, Any]:
    """Return the arguments of the study."""
    chosen = specification.cases.get(case)
    variant = chosen.variant if chosen is not None and chosen.variant else None
    full = {estimator_key(name): name for name in specification.estimators}
    asked: list[str] = []
    for requirement in requirements:
        metric = requirement.measured
        asked.append(requirement.estimator)
        requirement.estimator = estimator_key(requirement.estimator)
        if isinstance(metric, RmseRatio):
            asked.append(metric.to)
            metric.to = estimator_key(metric.to)
    full |= {estimator_key(name): name for name in asked if ":" in name}  # a bare name elsewhere means this class
    return {
        "system": find(specification.system, variant, path.parent),
        "scenario": path.parent / specification.scenario if specification.scenario else None,
        "set": [*specification.set, *(chosen.set if chosen is not None else [])],
        "estimators": list(dict.fromkeys(full.get(name, name) for name in asked)),
    }
