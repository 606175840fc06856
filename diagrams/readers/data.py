"""Where recorded data lie: the data folder, and what is in it."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from quietfix.diagrams.schema.errors import UserError

__all__ = ["Source", "data_folder"]


@dataclass(frozen=True)
class Source:
    """Where a recording comes from.

    Attributes
    ----------
    folder : str
        Its folder within the data folder; empty: it is in files of the user's own.
    origin : str
        Where anybody can get it, or what a file of one's own must be.
    holds : str
        A file (a pattern) by which a folder of any name is known to hold such a recording.
    several : bool
        Of files: whether there may be more than one.
    truth : bool
        Whether it says where the target was.
    """

    folder: str
    origin: str
    holds: str = ""
    several: bool = False
    truth: bool = True


def data_folder(source: Source, data: Path | str | None = None) -> Path:
    """Return the folder of a recording.

    Parameters
    ----------
    source : Source
        The recording.
    data : path, optional
        The data folder, or the recording's own; without it the environment variable ``QUIETFIX_DATA``. A folder that
        holds what `Source.holds` says may have any name.

    Raises
    ------
    UserError
        If there is no such folder; it says how to name one and where the recording comes from.
    """
    named = data or os.environ.get("QUIETFIX_DATA")
    advice = (
        f"name the folder that holds {source.folder} with --data DIR or in the environment variable QUIETFIX_DATA; "
        f"source: {source.origin}"
    )
    if not named:
        raise UserError(f"data: no folder is given; {advice}")
    folder = Path(named)
    for candidate in (folder / source.folder, folder):
        if candidate.name == source.folder and candidate.is_dir():
            return candidate
    if data and source.holds and any(folder.glob(source.holds)):
        return folder
    raise UserError(f"data: {folder / source.folder} is not a folder; {advice}")
