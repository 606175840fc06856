"""Comparisons as a command runs them: the chunks of all at once, each written into its folder, in any order."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.chunks.jobs import Job
from quietfix.diagrams.chunks.part import Part
from quietfix.diagrams.experiments.candidates import Lineup
from quietfix.diagrams.experiments.compared_study import COST, ComparedStudy
from quietfix.diagrams.experiments.comparison import comparison_statistics
from quietfix.diagrams.experiments.summary_entries import nearest_epoch
from quietfix.diagrams.scale.crew import Crew
from quietfix.diagrams.scale.resuming import concluded, earlier, joined, keeping, say_left
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.output import Finished, OutputFolder
from quietfix.diagrams.studies.results import write_summary

__all__ = ["Comparing", "compared"]

Array = NDArray[np.float64]


class Comparing:
    """One comparison while it is run.

    Parameters
    ----------
    study : ComparedStudy
    chosen : Lineup
        Who takes part.
    at : float, optional
        When the RMSE is taken [s].
    out : Path, optional
        Where it goes.
    overwrite : bool
        Whether it may replace an earlier result.
    resume : Path, optional
        What ``--resume`` names; finished chunks are kept then.

    Attributes
    ----------
    found : dict
        What ``comparison.json`` holds, in the end.
    wrote : bool
        Whether it was written now, and not found.
    """

    def __init__(
        self,
        study: ComparedStudy,
        chosen: Lineup,
        at: float | None,
        out: Path | None,
        overwrite: bool,
        resume: Path | None,
    ) -> None:
        self.study, self.out = study, out
        self.found: dict[str, Any] = {}
        self.wrote = False
        self.folder: OutputFolder | None = None
        self.plan = study.plan(command="compare", at=at)
        self._chosen, self._at, self._overwrite, self._resume = chosen, at, overwrite, resume is not None
        self._parts: list[Part] = []
        self._began = time.monotonic()

    def begin(self, stack: ExitStack) -> None:
        """Take the folder, until the stack unwinds; find what an earlier run has finished."""
        if self.out is None:
            return
        if self._resume and self._found_finished():
            return
        try:
            self.folder = OutputFolder(self.out, self._overwrite, "compare", plan=self.plan, resume=self._resume)
        except Finished:
            self._found_finished()
            return
        stack.enter_context(self.folder)

    def _found_finished(self) -> bool:
        assert self.out is not None
        before = earlier(self.out)
        if before is None:
            return False
        before.refuse_other(self.plan)
        if not before.finished or before.where != before.final:
            return False
        try:
            self.found = json.loads((self.out / "comparison.json").read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise UserError(f"--resume: {self.out} is not allowed; it holds no comparison") from error
        times = self.study.model.clock.ticks(self.study.model.duration)
        when = self.found.get("time_s")
        if when is not None and when != (now := float(times[nearest_epoch(times, self._at)])):
            raise UserError(f"--resume: at: {now:g} is not allowed; {self.out} has {when:g}")
        return True

    @property
    def left(self) -> list[int]:
        """Which chunks are left to run."""
        if self.found:
            return []
        if self.folder is not None:
            return sorted(self.folder.left)
        return [number for number in range(self.plan.chunks) if number not in {part.number for part in self._parts}]

    def take(self, part: Part) -> None:
        """Keep a chunk."""
        if self.folder is None:
            self._parts.append(part)
            return
        try:
            self.folder.write(part)
        except OSError as error:
            raise self.folder.refusal(error) from error

    def conclude(self) -> None:
        """Compare, now that all chunks are there, and write it."""
        if self.found:
            return
        if self.folder is None:
            dataset = joined(self.study, self._parts)
            self.found = self._statistics(dataset, [part.also[COST] for part in self._parts])
            self._parts.clear()
            return
        try:
            self._write(self.folder)
        except OSError as error:
            raise self.folder.refusal(error) from error

    def _statistics(self, dataset: xr.Dataset, spent: Sequence[Array]) -> dict[str, Any]:
        costs = self.study.costs_of(spent)
        found = comparison_statistics(dataset, self.study, self._chosen, at=self._at, costs=costs)
        return found | {"run_seconds": round(time.monotonic() - self._began, 3)}

    def _write(self, folder: OutputFolder) -> None:
        from quietfix.diagrams.figures import study_figures
        from quietfix.diagrams.figures.comparison import draw_comparison
        from quietfix.diagrams.figures.shared.style import save
        from quietfix.diagrams.statistics.metrics import summarise

        assert folder.ledger is not None
        dataset = concluded(folder, self.study).load()
        self.found = self._statistics(dataset, [folder.ledger.kept(n)[COST] for n in folder.ledger.finished()])
        text = json.dumps(self.found, indent=1, allow_nan=False) + "\n"
        (folder.work / "comparison.json").write_text(text, encoding="utf-8")
        write_summary(folder.work / "summary.json", dataset, summarise(dataset), self._began)
        save(draw_comparison(self.found), folder.work / "comparison.png")
        study_figures(dataset, folder.work)
        folder.finish()
        self.wrote = True


def compared(work: Sequence[Comparing], crew: Crew) -> Iterator[Comparing]:
    """Run comparisons, and yield each in its turn when it is finished."""
    with ExitStack() as stack:
        for one in work:
            one.begin(stack)
        folders = [one.folder for one in work if one.folder is not None]
        say_left(*folders)
        left = [set(one.left) for one in work]
        turn = 0
        parts = crew.run([Job(one.study, one.plan, one.left) for one in work])
        with keeping(*folders):
            while turn < len(work):
                if left[turn]:
                    which, part = next(parts)
                    work[which].take(part)
                    left[which].remove(part.number)
                    del part
                    continue
                work[turn].conclude()
                yield work[turn]
                turn += 1
