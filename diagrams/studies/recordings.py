"""What commands do with recordings: their data, their settings, and what makes no sense on one."""

from __future__ import annotations

import json
import re
import typing
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from quietfix.diagrams.assembly.find import RECORDINGS, Found, find
from quietfix.diagrams.readers.platforms import read_platforms
from quietfix.diagrams.readers.rows import broken
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.diagrams.schema.reading import fields_of
from quietfix.diagrams.schema.scenario import dump

__all__ = ["find_recording", "only_simulated", "recording_settings", "with_data", "with_measurements", "with_platforms"]

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")

_WHY = {
    "gdop": "its target is where it was, and a map needs one that can be put anywhere",
    "observe": "nobody knows all of the true state, along which observability is judged",
    "sweep": "its noise is what it was, and it is no ensemble; `quietfix run --set KEY=VALUE` changes what is believed",
    "compare": "nobody knows where its target was",
    "verify": "requirements are judged over as many trials as they need, and a recording has what was recorded",
}


def find_recording(name: str) -> Found:
    """Return a recording by its name.

    Raises
    ------
    UserError
        If there is none.
    """
    return find(choose("dataset", name, RECORDINGS))


def only_simulated(found: Found, command: str, scenario: Any = None) -> None:
    """Refuse a recording where a command needs a simulation.

    Parameters
    ----------
    found : Found
    command : str
    scenario : dataclass, optional
        One that has measurements in a file is a recording, too.

    Raises
    ------
    UserError
        Saying why.
    """
    if found.system.recording is not None or getattr(scenario, "measurements", None) is not None:
        raise UserError(f"{command}: {found.title} is not allowed; it is a recording: {_WHY[command]}")


def with_data(found: Found, settings: Sequence[str] | None, data: Sequence[Path] | None) -> list[str]:
    """Return ``KEY=VALUE`` settings with the folder or the files of a recording among them.

    Raises
    ------
    UserError
        If the system is no recording, or there are too many files.
    """
    chosen = list(settings or ())
    if not data:
        return chosen
    if found.system.recording is None:
        raise UserError(f"--data: {data[0]} is not allowed for {found.title}; it is no recording")
    if typing.get_origin(fields_of(found.system.scenario)["data"].type) is list:
        return [f"data={json.dumps([str(one.absolute()) for one in data])}", *chosen]
    if len(data) > 1:
        raise UserError(f"--data: {len(data)} are not allowed for {found.title}; one")
    return [f"data={json.dumps(str(data[0].absolute()))}", *chosen]


def with_measurements(
    found: Found, settings: Sequence[str] | None, measurements: Path | None, truth: Path | None
) -> list[str]:
    """Return ``KEY=VALUE`` settings with a table of measurements, and the truth, of a system of a user's own.

    Raises
    ------
    UserError
        If it is another system.
    """
    chosen = list(settings or ())
    for option, key, file in (
        ("--measurements", "measurements.file", measurements),
        ("--truth", "measurements.truth.file", truth),
    ):
        if file is None:
            continue
        if found.source != "yaml":
            raise UserError(f"{option}: {file} is not allowed for {found.title}; for a system of one's own in YAML")
        chosen.insert(0, f"{key}={json.dumps(str(file.absolute()))}")
    return chosen


def with_platforms(found: Found, settings: Sequence[str] | None, table: Path) -> list[str]:
    """Return ``KEY=VALUE`` settings with the platforms of a table, of a system of a user's own or a recording.

    Raises
    ------
    UserError
        If it is another system, and as `quietfix.diagrams.readers.platforms.read_platforms`.
    """
    if found.system.recording is not None and "platforms" in fields_of(found.system.scenario):
        return [f"platforms={json.dumps(str(table.absolute()))}", *(settings or ())]
    if found.source != "yaml":
        raise UserError(
            f"--platforms: {table} is not allowed for {found.title}; for a system of one's own in YAML, iq and kiwisdr"
        )
    chosen = []
    for name, rows in read_platforms(table).platforms.items():
        if not _NAME.fullmatch(name):
            raise broken(table, rows.line, f"name: {name[:60]!r} is not allowed; letters, digits and _, a letter first")
        chosen.append(f"platforms.{name}=!Platform {{file: {json.dumps(str(table.absolute()))}, name: {name!r}}}")
    return [*chosen, *(settings or ())]


def recording_settings(name: str) -> str:
    """Return the settings of a recording as commented YAML."""
    return dump(find_recording(name).system.load())
