"""A study again from its own result: everything that the result says is checked, and none of it names code."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from quietfix.diagrams.assembly.companions import changed
from quietfix.diagrams.assembly.find import PACKAGED, RECORDINGS, Found, find, fingerprint_of, read_own, systems
from quietfix.diagrams.assembly.source import look_in
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.diagrams.studies.marker import MARKER, read_mark
from quietfix.diagrams.studies.recordings import with_data
from quietfix.diagrams.studies.result_schema import check_version, upgraded_scenario
from quietfix.diagrams.studies.results import find_store
from quietfix.diagrams.studies.store import read_attributes

__all__ = ["ask_again", "ask_as"]

_SOURCES = ("packaged", "installed", "module", "file", "yaml", "object")


def ask_again(path: Path, system: str | None, asked: Mapping[str, Any], trust: bool) -> tuple[Found, dict[str, Any]]:
    """Return system and options of an earlier result, as `quietfix.diagrams.studies.study.Study` takes them.

    Parameters
    ----------
    path : Path
        The result.
    system : str, optional
        What the user names besides; it must be the result's. Code that a user names himself is trusted.
    asked : mapping
        Options that go before those of the result.
    trust : bool
        Whether a system and estimator classes that the result names may be imported.

    Raises
    ------
    UserError
        Naming the attribute, its value and what is allowed, or the class.
    """
    store = find_store(path)
    if os.path.lexists(store.parent / MARKER) and read_mark(store.parent, "--from") is None:
        raise UserError(f"--from: {path}: its {MARKER} is damaged, or no marker of a result")
    return ask_as(read_attributes(store), f"--from: {path}", system, asked, trust)


def ask_as(
    attributes: Mapping[str, Any], path: str, system: str | None, asked: Mapping[str, Any], trust: bool
) -> tuple[Found, dict[str, Any]]:
    """Return the same from a result's attributes alone; `path`: option and place where they are, for messages."""
    from quietfix.diagrams.studies.request import KEEP

    if "scenario" in asked:
        raise UserError(f"--scenario: it cannot be combined with {path.partition(':')[0]}; use --set")
    version = check_version(attributes, path)
    if attributes.get("system_source") == "yaml" and isinstance(attributes.get("scenario"), str):
        attributes = {**attributes, "scenario": upgraded_scenario(attributes["scenario"], version)}
    take = _Taker(path, attributes)
    take("version", _named, "text, the version of Quietfix that wrote it", str)
    found = _system_again(take, path, system, trust)
    variant = take("variant", lambda v: v and found.of(v).variant, "text", str) or None
    again: dict[str, Any] = {}
    for key, least in (("seed", 0), ("first_trial", 0), ("trials", 1), ("every", 1)):
        again[key] = take(key, _whole(key, least), f"a whole number >= {least}", int)
    again["keep"] = take("keep", lambda v: choose("keep", v, KEEP), "text", str)
    if system is not None and find(system).variant not in (None, variant):
        raise UserError(
            f"system: {system} is not that of {path.replace(': ', ' ', 1)}, which is {found.of(variant).title}"
        )
    files = take("system_files", _fingerprints, "text, paths and fingerprints as JSON", str, "{}")
    _say_changes(found, attributes.get("system_fingerprint", ""), path, files if isinstance(files, dict) else {})
    found = replace(found, variant=variant)
    take("scenario", lambda v: found.system.load(text=v, trust=trust), "text", str)
    options = dict(asked)
    settings = with_data(found, options.pop("set", []), options.pop("data", None))
    again["scenario"] = found.system.load(text=attributes["scenario"], settings=settings, trust=trust)
    if found.system.recording is not None and again["trials"] == attributes.get("tracks"):
        del again["trials"]  # all tracks, also where settings make more or fewer of them
    return found, again | options


def _system_again(take: _Taker, path: str, system: str | None, trust: bool) -> Found:
    """Return the system of a result, without a variant: what it names, or what the user names in its place."""
    source = take("system_source", lambda v: choose("system_source", v, _SOURCES), "text", str, "packaged")
    known = {"packaged": [*PACKAGED, *RECORDINGS], "installed": systems()}.get(source)
    name = take("system", lambda v: v if known is None else choose("system", v, known), "text", str)
    named = None if system is None else find(system)
    if named is not None and not _alike(named, name, source):
        raise UserError(f"system: {system} is not that of {path.replace(': ', ' ', 1)}, which is {name}")
    if source == "packaged":
        return find(name)
    file = take("system_file", str, "text", str, "")
    take("system_fingerprint", str, "text", str, "")
    if source == "yaml":
        text = take("scenario", str, "text", str)
        place = Path(file) if named is None or named.place is None else named.place  # it may have moved
        if trust and file:
            look_in(place.parent)
        return Found(read_own(place, text), None, name, "yaml", place, fingerprint_of(place))
    return replace(named or _code_again(name, source, file, trust), variant=None)


def _alike(named: Found, name: str, source: str) -> bool:
    """Return whether a system that a user names can be the one of a result; its file may have moved."""
    if source in ("packaged", "installed"):
        return named.reference == name
    if source == "yaml":
        return named.source == "yaml"
    return named.source not in ("packaged", "yaml") and name.rpartition(":")[2] in (
        named.reference.rpartition(":")[2],
        named.system.name,
    )


def _code_again(name: str, source: str, file: str, trust: bool) -> Found:
    if source == "object":
        raise UserError(
            f"system: {name} was an object in Python that no module has; name where it is now, before --from: "
            "package.module:OBJECT or FILE.py:OBJECT"
        )
    if source == "installed":
        return find(name)
    if not trust:
        raise UserError(
            f"system: {name} is code that the result names, and is not imported; name it yourself, before --from, or "
            "add --trust if you know it"
        )
    if source == "file" and file and Path(file).is_file():
        return replace(find(f"{file}:{name.rpartition(':')[2]}"), reference=name)
    return find(name)


def _fingerprints(text: str) -> dict[str, str]:
    try:
        found = json.loads(text)
    except (ValueError, RecursionError):
        found = None
    if not isinstance(found, dict) or not all(isinstance(value, str) for value in found.values()):
        raise UserError(f"system_files: {text!r:.80} is not allowed; paths and fingerprints as JSON")
    return found


def _say_changes(found: Found, before: str, path: str, files: Mapping[str, str]) -> None:
    """Say in a line each whether a system, and a file beside it, is not any more what it was when a result was made."""
    for name, how in changed(files, None if found.place is None else found.place.parent).items():
        used = ": it is used as it is now" if how == "has changed" else ""
        warnings.warn(f"{name} {how} since {_place(path)} was made{used}", stacklevel=1)
    if found.fingerprint == before:
        return
    what = "has changed" if found.fingerprint else "is not there any more"
    # all of a system of YAML is in the result
    how = "in the result" if found.source == "yaml" else "now"
    warnings.warn(f"{found.reference} {what} since {_place(path)} was made: it runs as it is {how}", stacklevel=1)


def _named_place(path: str) -> str:
    return path.replace(": ", " ", 1)


def _place(path: str) -> str:
    return path.partition(": ")[2]


class _Taker:
    """Take attributes of a result one by one."""

    def __init__(self, path: str, attributes: Mapping[str, Any]) -> None:
        self._path, self._attributes = path, attributes

    def __call__(self, key: str, check: Callable[[Any], Any], words: str, kind: type, default: Any = None) -> Any:
        """Return what `check` makes of an attribute of the right type; `default`: where it may be missing."""
        if key not in self._attributes and default is not None:
            return default
        if key not in self._attributes:
            raise UserError(f"{self._path}: {key}: it is missing; {words}")
        value = self._attributes[key]
        if type(value) is not kind:
            raise UserError(f"{self._path}: {key}: {value!r:.80} is not allowed; {words}")
        try:
            return check(value)
        except UserError as error:
            raise UserError(f"{self._path}: {error}") from error


def _named(version: str) -> str:
    if not version.strip():
        raise UserError("version: '' is not allowed; the version of Quietfix that wrote it")
    return version


def _whole(key: str, least: int) -> Callable[[int], int]:
    def check(value: int) -> int:
        if not least <= value < 2**53:
            raise UserError(f"{key}: {value!r:.80} is not allowed; a whole number from {least} to {2**53 - 1}")
        return value

    return check
