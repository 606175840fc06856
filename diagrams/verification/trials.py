"""A study that grows: trials n, n+1 ... continue it, since noise is a pure function of the trial's number."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.assembly.lineup import estimator_key
from quietfix.diagrams.chunks.jobs import Job
from quietfix.diagrams.chunks.part import added
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.diagrams.studies.study import Study
from quietfix.diagrams.verification.metrics import RmseRatio
from quietfix.diagrams.verification.specification import Requirement, Specification
from quietfix.diagrams.verification.study_view import StudyFacts, StudyView

__all__ = ["GrowingStudy", "NotYet"]

Array = NDArray[np.float64]
Kept = Mapping[str, NDArray[Any]]


class NotYet(Exception):
    """Trials are asked for that have not been run: those of a case up to a look."""

    def __init__(self, case: str, look: int) -> None:
        super().__init__(case, look)
        self.case, self.look = case, look


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
    chunk, threads : int
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
        chunk: int | None = None,
        threads: int = 1,
    ) -> None:
        self.requirements = [r for r in specification.requirements if r.case == case]
        self.looks, self.case = tuple(looks), case
        options = _options(specification, path, case, self.requirements)
        self._study = Study(**options, trials=self.looks[-1], seed=seed, chunk=chunk, threads=threads)
        self.plan = self._study.plan(command="verify")
        self._beside = path.parent
        self._counts = np.diff([0, *self.looks]).tolist()
        self._widths = self._study.widths(self._counts)
        self.run = StudyFacts(self._study.probe)
        self.version = str(self._study.attributes()["version"])
        for i, requirement in enumerate(specification.requirements):
            if requirement.case == case:
                self._check(requirement, f"requirements.{i}")
        self._parts: dict[tuple[int, int], tuple[Array | None, Kept]] = {}
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

    def chunks(self, look: int) -> int:
        """Return into how many chunks the trials are cut that a look has more than the one before."""
        return -(-self._counts[look] // self._widths[look])

    def job(self, look: int) -> Job:
        """Return what is to be run for a look; chunks that are there already are left out."""
        numbers = [number for number in range(self.chunks(look)) if (look, number) not in self._parts]
        first = self.looks[look - 1] if look else 0
        return Job(self._study, self.plan, numbers, first, self._counts[look], self._widths[look], self._beside)

    def reduced(self, chunk: xr.Dataset) -> Kept:
        """Return what is kept of a chunk: by requirement, what it takes of every trial."""
        view = StudyView(chunk)
        return {str(i): r.measured.reduce(view, r.estimator, self.run) for i, r in enumerate(self.requirements)}

    def take(self, look: int, number: int, sums: Array | None, kept: Kept) -> None:
        """Keep a chunk: its part of the sums, and what `reduced` gives of it."""
        self._parts[look, number] = sums, kept

    def _grow(self) -> None:
        """Add the trials up to the next look.

        Raises
        ------
        NotYet
            If they have not been run.
        """
        look = len(self._samples)
        numbers = range(self.chunks(look))
        if any((look, number) not in self._parts for number in numbers):
            raise NotYet(self.case, look)
        parts = [self._parts.pop((look, number)) for number in numbers]
        found = self._study.bounds(added(sums for sums, _ in parts), self.run.epochs)
        bounds = xr.Dataset(found, {"estimator": self.run.estimators})
        self._samples.append(
            [np.concatenate([kept[str(i)] for _, kept in parts]) for i in range(len(self.requirements))]
        )
        self._squares.append([r.measured.bound_square(bounds, r.estimator, self.run) for r in self.requirements])

    def samples(self, requirement: Requirement, trials: int) -> Array:
        """Return the samples (n, columns) of the first `trials` trials, without those that have none.

        Raises
        ------
        UserError
            If no trial has one, or the system has no such bound.
        NotYet
            If so many have not been run.
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
