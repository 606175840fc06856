"""Estimator blocks on recorded measurements: which recordings there are, where they lie, and what a replay gives."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

from diagrams.assembly.find import RECORDINGS, Found
from diagrams.errors import UserError, choose
from diagrams.recordings import find_recording

if TYPE_CHECKING:
    from diagrams.tables import Table

__all__ = ["REPLAYS", "Dataset", "Kept", "Replay", "data_folder", "replay", "replay_settings"]

REPLAYS: dict[str, str] = {
    "bearings": "diagrams.bearings:DATASET",
}
"""Where each data set's `Dataset` is, as ``module:NAME``; a new replay is one line here."""


class Replay(Protocol):
    """What came out of a replay."""

    def table(self) -> Table:
        """Return the table that is printed."""

    def notes(self) -> list[str]:
        """Return lines for below the table."""

    def summary(self) -> Mapping[str, Any]:
        """Return numbers for ``summary.json``; null where undefined."""

    def draw(self, folder: Path) -> list[Path]:
        """Draw the figures into a folder and return their paths."""


class Kept(Protocol):
    """Recorded data that lie in the data folder."""

    @property
    def folder(self) -> str:
        """Its folder within the data folder."""

    @property
    def source(self) -> str:
        """Where anybody can get it."""


@dataclass(frozen=True)
class Dataset:
    """A recording that can be replayed.

    Attributes
    ----------
    name : str
        As on the command line.
    folder : str
        Its folder within the data folder.
    source : str
        Where anybody can get it.
    run : callable
        ``run(folder, progress) -> Replay``; `progress` shows a bar where that is wanted.
    takes_file : bool
        True: a file of the user's own is replayed, and `run` gets it instead of a folder.
    several_files : bool
        True: there may be any number of files, and `run` gets a list of them.
    holds : str
        A file (a pattern) by which a folder of any name is known to hold such a recording.
    settings : type, optional
        A dataclass whose fields ``--set`` changes; `run` then gets one of it as a third argument. A method ``refused``,
        if it has one, says what is wrong with it as a whole.
    """

    name: str
    folder: str
    source: str
    run: Callable[..., Replay]
    takes_file: bool = False
    several_files: bool = False
    holds: str = ""
    settings: type[Any] | None = None


def data_folder(dataset: Kept, data: Path | str | None, holds: str = "") -> Path:
    """Return the folder of a recording.

    Parameters
    ----------
    dataset : Kept
        The recording, such as a `Dataset`.
    data : path, optional
        The data folder, or the recording's own; without it the environment variable ``QUIETFIX_DATA``.
    holds : str
        A folder that is given and holds such a file (a pattern) may have any name.

    Raises
    ------
    UserError
        If there is no such folder; it says how to name one and where the recording comes from.
    """
    named = data if data is not None else os.environ.get("QUIETFIX_DATA")
    advice = (
        f"name the folder that holds {dataset.folder} with --data DIR or in the environment variable QUIETFIX_DATA; "
        f"source: {dataset.source}"
    )
    if not named:
        raise UserError(f"data: no folder is given; {advice}")
    folder = Path(named)
    for candidate in (folder / dataset.folder, folder):
        if candidate.name == dataset.folder and candidate.is_dir():
            return candidate
    if data is not None and holds and any(folder.glob(holds)):
        return folder
    raise UserError(f"data: {folder / dataset.folder} is not a folder; {advice}")


def replay(
    dataset: str,
    data: Path | str | None = None,
    out: Path | str | None = None,
    progress: bool = True,
    file: Path | str | Sequence[Path | str] | None = None,
    settings: Sequence[str] = (),
    estimators: Sequence[str] | None = None,
    overwrite: bool = False,
) -> Any:
    """Run a recording as ``quietfix run`` does, print its tables and, if asked, write its results.

    Parameters
    ----------
    dataset : str
        Its name.
    data : path, optional
        See `data_folder`.
    out : path, optional
        Folder for what is written: a new one, or see `overwrite`.
    progress : bool
        Show a progress bar.
    file : path or sequence of path, optional
        What is replayed, where the data set takes files of the user's own.
    settings : sequence of str
        ``KEY=VALUE``, changes of the scenario.
    estimators : sequence of str, optional
        By default those of the scenario.
    overwrite : bool
        Whether an earlier result in `out` may be replaced.

    Returns
    -------
    Report
        What the recording tells.

    Raises
    ------
    UserError
        For an unknown data set, missing or broken data, or a folder that cannot be written.
    """
    from diagrams.output import OutputFolder
    from systems.registry import object_at

    files = [Path(file)] if isinstance(file, str | Path) else [Path(one) for one in file or ()]
    if choose("dataset", dataset, [*RECORDINGS, *REPLAYS]) not in REPLAYS:
        from diagrams.running import run_command

        asked = {"data": _places(find_recording(dataset), data, files), "set": settings, "estimators": estimators}
        return run_command(dataset, {k: v for k, v in asked.items() if v}, None, _path(out), overwrite, False, progress)
    if estimators:
        raise UserError(f"--estimator: {estimators[0]} is not allowed for {dataset}")
    entry: Dataset = object_at(REPLAYS[dataset])
    extra = _settings(entry, settings)
    source = _own_files(entry, files) if entry.takes_file or files else data_folder(entry, data, entry.holds)
    if out is None:
        return _shown(entry, source, progress, extra)
    with OutputFolder(out, overwrite, "replay") as folder:
        began = time.monotonic()
        result = _shown(entry, source, progress, extra)
        _write(result, folder.work, dataset, time.monotonic() - began)
        folder.finish()
    return result


def _places(found: Found, data: Path | str | None, files: Sequence[Path]) -> list[Path]:
    """Return the folder, or the files of a user's own, of a recording."""
    source = found.system.recording
    assert source is not None
    if source.folder:
        if files:
            raise UserError(f"FILE: {files[0]} is not allowed for {found.title}; its recording is in the data folder")
        return [] if data is None else [Path(data)]
    if data is not None:
        raise UserError(f"--data: {data} is not allowed for {found.title}; name the files themselves")
    if not files:
        raise UserError(f"FILE: it is missing; {found.title} replays {source.origin}")
    return list(files)


def _path(out: Path | str | None) -> Path | None:
    return None if out is None else Path(out)


def _shown(dataset: Dataset, source: Any, progress: bool, extra: Sequence[Any]) -> Replay:
    """Run a replay and print its table."""
    from diagrams.tables import print_table
    from diagrams.terminal import say

    result = dataset.run(source, progress, *extra)
    print_table(result.table())
    for note in result.notes():
        say(note)
    return result


def _own_files(dataset: Dataset, files: list[Path]) -> Path | list[Path]:
    if not dataset.takes_file:
        raise UserError(f"FILE: {files[0]} is not allowed for {dataset.name}; its recording is in the data folder")
    if not files:
        raise UserError(f"FILE: it is missing; {dataset.name} replays {dataset.source}")
    if dataset.several_files:
        return files
    if len(files) > 1:
        raise UserError(f"FILE: {len(files)} files are not allowed for {dataset.name}; one")
    return files[0]


def replay_settings(dataset: str, settings: Sequence[str] = ()) -> str:
    """Return the settings of a replay as commented YAML.

    Parameters
    ----------
    dataset : str
        A name of `REPLAYS`.
    settings : sequence of str
        ``KEY=VALUE`` that are changed.

    Raises
    ------
    UserError
        For a setting that is unknown or not allowed.
    """
    from diagrams.scenario import dump
    from systems.registry import object_at

    found = _settings(object_at(REPLAYS[choose("dataset", dataset, REPLAYS)]), settings)
    return dump(found[0]) if found else "{}  # it has no settings\n"


def _settings(dataset: Dataset, settings: Sequence[str]) -> list[Any]:
    if dataset.settings is None:
        if settings:
            raise UserError(f"--set: {settings[0]} is not allowed for {dataset.name}; it has no settings")
        return []
    from diagrams.scenario import apply_setting, load

    data: dict[str, Any] = {}
    for setting in settings:
        data = apply_setting(data, setting)
    found = load(dataset.settings, [data])
    refused = found.refused() if hasattr(found, "refused") else ""
    if refused:
        raise UserError(refused)
    return [found]


def _write(result: Replay, out: Path, dataset: str, seconds: float) -> None:
    try:
        installed = version("quietfix")
    except PackageNotFoundError:
        installed = "0"
    content = {"dataset": dataset, "version": installed, "run_seconds": round(seconds, 3), **result.summary()}
    result.draw(out)
    (out / "summary.json").write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")
