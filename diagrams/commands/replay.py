"""Running a recording in fewer words than any system: its data, settings and estimators by name."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from quietfix.diagrams.assembly.find import Found
from quietfix.diagrams.assembly.recorded import Report
from quietfix.diagrams.commands.running import run_command
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.recordings import find_recording

__all__ = ["replay"]


def replay(
    dataset: str,
    data: Path | str | None = None,
    out: Path | str | None = None,
    progress: bool = True,
    file: Path | str | Sequence[Path | str] | None = None,
    settings: Sequence[str] = (),
    estimators: Sequence[str] | None = None,
    overwrite: bool = False,
    platforms: Path | str | None = None,
    write_measurements: bool = False,
    resume: Path | str | None = None,
    report: bool = False,
) -> Report | None:
    """Run a recording as ``quietfix run`` does, print its tables and, if asked, write its results.

    Parameters
    ----------
    dataset : str
        Its name.
    data : path, optional
        See `quietfix.diagrams.readers.data.data_folder`.
    out : path, optional
        Folder for what is written: a new one, or see `overwrite`.
    progress : bool
        Show a progress bar.
    file : path or sequence of path, optional
        What is run, where the recording is in files of the user's own.
    settings : sequence of str
        ``KEY=VALUE``, changes of the scenario.
    estimators : sequence of str, optional
        By default those of the scenario.
    overwrite : bool
        Whether an earlier result in `out` may be replaced.
    platforms : path, optional
        Where receivers stand, a table, of a recording that can use one.
    write_measurements : bool
        Write what was measured as a table; see ``quietfix run --help``.
    resume : path, optional
        In place of `out`: an interrupted run of the same, which goes on.
    report : bool
        Keep what a page of the result needs.

    Returns
    -------
    Report or None
        What the recording tells.

    Raises
    ------
    UserError
        For an unknown recording, missing or broken data, a setting that is not allowed, or a folder that cannot be
        written.
    """
    found = find_recording(dataset)
    found.system.load(settings=settings)  # mistakes there show before anything is read
    files = [Path(file)] if isinstance(file, str | Path) else [Path(one) for one in file or ()]
    asked: dict[str, Any] = {"data": _places(found, data, files), "set": settings, "estimators": estimators}
    asked |= {"platforms": None if platforms is None else Path(platforms), "write_measurements": write_measurements}
    asked |= {"report": report}
    given = {key: value for key, value in asked.items() if value}
    where, before = (None if path is None else Path(path) for path in (out, resume))
    return run_command(dataset, given, None, where, overwrite, False, progress, before)


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
    if len(files) > 1 and not source.several:
        raise UserError(f"FILE: {len(files)} files are not allowed for {found.title}; one")
    return list(files)
