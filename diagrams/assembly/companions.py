"""Files that a system is made of beside its own: tracks, orbits, modules of a user's classes; whether they changed."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from quietfix.diagrams.assembly.find import Found, fingerprint_of
from quietfix.diagrams.assembly.lineup import parts_of
from quietfix.diagrams.assembly.source import is_users
from quietfix.diagrams.readers.data import data_folder
from quietfix.diagrams.schema.errors import UserError

__all__ = ["changed", "companions"]


def companions(found: Found, scenario: Any) -> dict[str, str]:
    """Return fingerprints of the files that a scenario names, and of the modules it is made of, by their paths.

    Parameters
    ----------
    found : Found
        The system; paths within its folder are relative to that, so that both can move together.
    scenario : dataclass
        Whatever in it has a field ``file`` or ``class``, whose module is loaded; of a recording its field ``data``.
    """
    folder = None if found.place is None else found.place.parent
    files = dict.fromkeys([*found.beside, *_named(scenario, folder), *_recorded(found, scenario)])
    return {_shown(path, folder): fingerprint_of(path) for path in files if path != found.place}


def _named(scenario: Any, folder: Path | None) -> Iterator[Path]:
    for _, part in parts_of(scenario):
        file, path = getattr(part, "file", None), getattr(part, "class_", None)
        if isinstance(file, str) and file and folder is not None:
            yield folder / file
        if isinstance(path, str):
            module = sys.modules.get(path.partition(":")[0])
            place = getattr(module, "__file__", None)
            if place and is_users(place):
                yield Path(place)


def _recorded(found: Found, scenario: Any) -> Iterator[Path]:
    """Yield the files of a recording."""
    source = found.system.recording
    if source is None:
        return
    if source.folder:
        try:
            folder = data_folder(source, scenario.data)
        except UserError:  # what is run was not read there
            return
        yield from sorted(path.resolve() for path in folder.iterdir() if path.is_file())
        return
    files = [scenario.data] if isinstance(scenario.data, str) else scenario.data
    yield from (Path(file).resolve() for file in files)


def _shown(path: Path, folder: Path | None) -> str:
    return str(path.relative_to(folder) if folder is not None and path.is_relative_to(folder) else path)


def changed(before: Mapping[str, str], folder: Path | None) -> dict[str, str]:
    """Return which files are not any more what they were, and how.

    Parameters
    ----------
    before : mapping of str to str
        What `companions` told.
    folder : Path, optional
        Where the system's own file is now.
    """
    found = {}
    for name, fingerprint in before.items():
        now = fingerprint_of((folder or Path()) / name)
        if now != fingerprint:
            found[name] = "has changed" if now else "is not there any more"
    return found
