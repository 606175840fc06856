"""Where recorded data lie: they are never part of the project."""

from __future__ import annotations

import os
from pathlib import Path

from diagrams.errors import UserError

__all__ = ["SOURCES", "data_set"]

SOURCES = {
    "doptrack_delfic3": "DopTrack/estimate at cd28508, sod_assignments/{data,metadata}.tar.xz (TU Delft)",
    "falcon9_telemetry": "github.com/shahar603/Telemetry-Data at b245d3b",
}
"""Public source of each data set."""


def data_set(name: str, data: Path | None = None) -> Path:
    """Return the folder of a data set.

    Parameters
    ----------
    name : str
        Folder of the data set.
    data : path, optional
        Folder of all data (``--data``); by default the environment variable QUIETFIX_DATA.

    Raises
    ------
    UserError
        If there is none, naming both ways to give it and the public source.
    """
    given = data if data is not None else os.environ.get("QUIETFIX_DATA")
    folder = Path(given) / name if given else None
    if folder is None or not folder.is_dir():
        where = f"no folder {folder}" if folder else "neither is given"
        raise UserError(
            f"data: {where}; give the folder that holds {name} by --data or the environment variable QUIETFIX_DATA "
            f"(public source: {SOURCES.get(name, 'unknown')})"
        )
    return folder
