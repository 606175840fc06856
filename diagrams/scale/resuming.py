"""Runs that write their chunks as they come, and go on from those that an interrupted run has finished."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import xarray as xr

from quietfix.diagrams.chunks.ledger import read_plan
from quietfix.diagrams.chunks.part import Part, added
from quietfix.diagrams.chunks.plan import Plan
from quietfix.diagrams.console.terminal import say
from quietfix.diagrams.scale.crew import Lost
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.tally import Ensemble, together
from quietfix.diagrams.studies.described import described
from quietfix.diagrams.studies.marker import read_mark
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.diagrams.studies.results import open_result
from quietfix.diagrams.studies.store import read_attributes
from quietfix.diagrams.studies.study import Study
from quietfix.diagrams.studies.whole import join

__all__ = [
    "Earlier",
    "begun_or_interrupted",
    "concluded",
    "earlier",
    "ensemble_of",
    "interrupted",
    "joined",
    "keeping",
    "run_into",
    "say_interrupted",
    "say_left",
]


@dataclass(frozen=True)
class Earlier:
    """A run that is to be resumed.

    Attributes
    ----------
    final : Path
        Name of its folder when it is finished.
    where : Path
        Where it is now.
    attributes : dict
        What it was asked for, as a result says it.
    plan : Plan, optional
        The same, and how it is cut, as long as it is not finished.
    finished : bool
        Whether nothing is left of it but a name at most.
    """

    final: Path
    where: Path
    attributes: dict[str, Any]
    plan: Plan | None
    finished: bool

    def refuse_other(self, plan: Plan) -> None:
        """Refuse to go on with another run; see `Plan.refuse_other`."""
        if self.plan is not None:
            self.plan.refuse_other(plan)
            return
        asked = {key: value for key, value in plan.asked.items() if key in self.attributes}
        Plan(self.attributes, plan.trials, plan.chunk).refuse_other(Plan(asked, plan.trials, plan.chunk))


def earlier(folder: Path) -> Earlier | None:
    """Return the run of a folder's name, which may be interrupted or finished; None if there is none.

    Parameters
    ----------
    folder : Path
        Its final name, or that of its unfinished work.
    """
    final = folder.with_name(folder.name.removesuffix(".partial"))
    partial = final.with_name(f"{final.name}.partial")
    for where in (partial, final):
        mark = None if where.is_symlink() else read_mark(where, "--resume")
        plan = None if mark is None or where == final else read_plan(where)
        if mark is not None and mark.finished and (where / "results.zarr").is_dir():
            return Earlier(final, where, read_attributes(where / "results.zarr"), None, True)
        if plan is not None:
            return Earlier(final, where, plan.asked, plan, False)
    return None


def interrupted(folder: Path, system: str | None, out: Path | None, from_: Path | None) -> Earlier | None:
    """Return the run that ``--resume`` names; None: there is none, but what is asked for can be begun.

    Raises
    ------
    UserError
        If there is none, and nothing is asked for; or for options that make no sense with it.
    """
    for option, value in (("--out", out), ("--from", from_)):
        if value is not None:
            raise UserError(f"{option}: {value} is not allowed with --resume {folder}, which says where the run is")
    found = earlier(folder)
    if found is None and system is None:
        raise UserError(
            f"--resume: {folder} is not allowed; the folder of a run that was interrupted and has finished chunks, in "
            f"{folder.name}.partial, or name the system as well to begin one"
        )
    return found


def begun_or_interrupted(out: Path | None, resume: Path | None) -> Path | None:
    """Return where a command writes that is resumed by saying it again with ``--resume`` in place of ``--out``.

    Raises
    ------
    UserError
        If both are given.
    """
    if resume is None:
        return out
    if out is not None:
        raise UserError(f"--out: {out} is not allowed with --resume {resume}, which says where the run is")
    return resume.with_name(resume.name.removesuffix(".partial"))


def run_into(folder: OutputFolder, study: Study, parts: Iterable[Part]) -> xr.Dataset:
    """Write a study into a folder, chunk by chunk.

    Parameters
    ----------
    folder : OutputFolder
        With the plan of the study; it may hold chunks that an interrupted run has finished.
    study : Study
    parts : iterable of Part
        All other chunks, in any order.

    Returns
    -------
    xarray.Dataset
        The result; arrays are read when they are used.
    """
    say_left(folder)
    with keeping(folder):
        for part in parts:
            folder.write(part)
            del part
    return concluded(folder, study)


def concluded(folder: OutputFolder, study: Study) -> xr.Dataset:
    """Add to the finished chunks of a study what is of all of them, and return the result; arrays are not read."""
    assert folder.ledger is not None
    times = open_result(folder.store)["time"].values
    bounds = study.bounds(added(folder.ledger.sums()), times)
    folder.add(described(xr.Dataset(bounds, attrs=study.attributes())))
    return open_result(folder.store)


def ensemble_of(folder: OutputFolder, dataset: xr.Dataset) -> Ensemble:
    """Return what can be told of all trials of a result that `run_into` wrote, from the sums of its chunks."""
    assert folder.ledger is not None
    tallies = list(folder.ledger.tallies())
    return Ensemble(dataset, together(tallies) if all(tallies) else None)


@contextmanager
def keeping(*folders: OutputFolder) -> Iterator[None]:
    """Say what is kept of runs that are interrupted, or lose their workers."""
    try:
        yield
    except KeyboardInterrupt:
        for folder in folders:
            say_interrupted(folder)
        raise
    except Lost as error:
        kept = [folder.kept for folder in folders if folder.chunks] or ["nothing is kept"]
        raise UserError(f"{error}; {', '.join(kept)}") from error


def say_left(*folders: OutputFolder) -> None:
    """Say how much of runs that are resumed is left to run."""
    for folder in folders:
        if folder.chunks and folder.ledger is not None:
            of, what = _counted(folder)
            say(f"{of - folder.trials} of {of} {what} are left to run")


def _counted(folder: OutputFolder) -> tuple[int, str]:
    """Return how much a run is, and what is counted."""
    assert folder.ledger is not None
    return folder.ledger.plan.trials, f"{folder.along}s"


def joined(study: Study, parts: Iterable[Part]) -> xr.Dataset:
    """Return the result of a study from its chunks in any order."""
    ordered = sorted(parts, key=lambda part: part.number)
    whole = join([part.dataset for part in ordered])
    bounds = study.bounds(added(part.sums for part in ordered), whole["time"].values)
    return described(whole.assign(bounds))


def say_interrupted(folder: OutputFolder) -> None:
    """Say on standard error what an interrupted run has finished."""
    if folder.ledger is not None and folder.chunks:
        of, what = _counted(folder)
        url = getattr(folder, "url", None)  # of one that is in an object store, too
        final, kept = (url, url) if url else (folder.final, folder.partial)
        command = folder.ledger.plan.asked.get("command", "run")
        again = f"with --resume {final} the same `quietfix {command}` goes on"
        if command == "run":
            again = f"`quietfix run --resume {final}` goes on"
        print(f"quietfix: {folder.trials} of {of} {what} are kept in {kept}; {again}", file=sys.stderr)
