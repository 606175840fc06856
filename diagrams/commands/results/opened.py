"""A result that a command was given: whole, readable, of this version's form, and of a kind that has trials."""

from __future__ import annotations

import atexit
import os
import shutil
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import mkdtemp

import xarray as xr

from quietfix.diagrams.chunks.ledger import read_plan
from quietfix.diagrams.cloud.mirrored import fetched
from quietfix.diagrams.cloud.place import is_url
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.diagrams.studies.marker import MARKER, read_mark, refuse_changed
from quietfix.diagrams.studies.result_schema import SCHEMA_VERSION, check_version
from quietfix.diagrams.studies.results import find_store, open_result

__all__ = ["Opened", "chosen", "opened", "reading"]

_OF_A_STUDY = ("estimate", "truth", "nees", "nis", "nis_dof")
_OF_A_SWEEP = ("position_error", "nees", "diverged", "not_started", "states", "at")
_KINDS = "run, compare, sweep or replay"


@dataclass(frozen=True)
class Opened:
    """A result.

    Attributes
    ----------
    path : Path or str
        As it was named; of one in an object store its URL.
    folder : Path
        Where its store is.
    kind : str
        The command that wrote it; ``run`` where nothing says so.
    dataset : xarray.Dataset
        Arrays are read when they are used.
    asked : int
        How many trials were asked for; more than there are of one that was interrupted.
    """

    path: Path | str
    folder: Path
    kind: str
    dataset: xr.Dataset
    asked: int

    @property
    def sweeps(self) -> bool:
        """Whether it is one of a sweep."""
        return "point" in self.dataset.dims

    @property
    def title(self) -> str:
        """Which system, how many trials, which seed."""
        attributes = self.dataset.attrs
        variant = f":{attributes['variant']}" if attributes.get("variant") else ""
        count = self.dataset.sizes["trial"]
        of = f" of {self.asked}" if self.asked > count else ""
        trials = f"{count}{of} {'track' if 'track' in self.dataset.coords else 'trial'}{'s' * (self.asked != 1)}"
        return f"{attributes.get('system', 'study')}{variant}, {trials}, seed {attributes.get('seed', '?')}"


def opened(path: Path, command: str) -> Opened:
    """Open a result.

    Parameters
    ----------
    path : Path
        Its folder, or the ``results.zarr`` in it; the URL of one in an object store, which is fetched.
    command : str
        Which command wants it, for messages.

    Raises
    ------
    UserError
        If there is none, it has no trials, an earlier or a later version wrote it, or it is not what was written.
    """
    if is_url(path):
        work = mkdtemp(prefix="quietfix-")
        atexit.register(shutil.rmtree, work, True)
        url, here = fetched(path, command, Path(work))
        return replace(opened(here, command), path=url)
    folder = path.parent if path.suffix == ".zarr" else path
    mark = read_mark(folder, command)
    if mark is None and os.path.lexists(folder / MARKER):
        raise UserError(f"{command}: {path}: its {MARKER} is damaged, or no marker of a result")
    if mark is not None and not (folder / "results.zarr").is_dir():
        if not mark.finished:
            raise UserError(
                f"{command}: {path} is the unfinished work of `quietfix {mark.kind}`; go on with it first "
                f"(`quietfix {mark.kind} ... --resume {folder.with_suffix('')}`)"
            )
        raise UserError(f"{command}: {path} is a result of `quietfix {mark.kind}` without trials; one of {_KINDS}")
    find_store(path)
    refuse_changed(folder, command, path)
    with reading(path, command):
        dataset = open_result(path)
    if (version := check_version(dataset.attrs, f"{command}: {path}")) < SCHEMA_VERSION:
        raise UserError(
            f"{command}: {path}: schema_version: {version} is not allowed; {SCHEMA_VERSION}: an earlier version of "
            f"Quietfix wrote it, and `quietfix run --from {path}` runs it again"
        )
    _check(dataset, path, command)
    plan = read_plan(folder)
    asked = dataset.sizes["trial"] if plan is None else plan.trials
    return Opened(path, folder, "run" if mark is None else mark.kind, dataset, asked)


def _check(dataset: xr.Dataset, path: Path, command: str) -> None:
    """Refuse what is no result of a study or a sweep."""
    if "trial" not in dataset.dims or dataset.sizes["trial"] == 0:
        raise UserError(f"{command}: {path} has no trials; a result of {_KINDS}")
    if "estimator" not in dataset.coords:
        raise UserError(f"{command}: {path}: nothing is estimated in {dataset.attrs.get('system', 'it')}")
    wanted = _OF_A_SWEEP if "point" in dataset.dims else _OF_A_STUDY
    if missing := [name for name in wanted if name not in dataset]:
        raise UserError(f"{command}: {path} is damaged: it has no {', '.join(missing)}")


@contextmanager
def reading(path: Path, command: str) -> Iterator[None]:
    """Turn what is raised for arrays that cannot be read into one line."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # of numbers that are not finite
            yield
    except (RuntimeError, ValueError, KeyError, OSError) as error:
        if isinstance(error, UserError):
            raise
        reason = " ".join(str(error).split())
        raise UserError(f"{command}: {path} cannot be read ({reason or type(error).__name__})") from error


def chosen(result: Opened, estimators: Sequence[str] | None) -> list[str]:
    """Return the estimators that are asked for, by default all of a result.

    Raises
    ------
    UserError
        If it does not have one.
    """
    names = [str(name) for name in result.dataset["estimator"].values]
    return [choose("--estimator", name, names) for name in estimators] if estimators else names
