"""A new system of a user's own: files that run as they are written, to be changed."""

from __future__ import annotations

import keyword
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from importlib.resources import files
from importlib.util import find_spec
from pathlib import Path

from quietfix.diagrams.console.answer import asked_for_json, tell
from quietfix.diagrams.console.terminal import say
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.diagrams.writers.whole_file import undisturbed

__all__ = ["TEMPLATES", "new_command", "new_files"]

TEMPLATES = ("drone", "ship", "beacon")
"""What a system of YAML can begin as; the first one unless another is asked for."""

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]{0,59}")
_WORDS = "letters, digits, _ and -, a letter first, at most 60"


def new_command(name: str, template: str | None, python: bool) -> None:
    """Write a new system into the current folder, and print what to do next.

    Raises
    ------
    UserError
        For a name that is not allowed, a template that is not there, files that are there already, or a folder that
        cannot be written.
    """
    if python and template is not None:
        raise UserError(f"--template: {template} is not allowed with --python, which has one of its own")
    texts = new_files(name, template or TEMPLATES[0], python)
    _write(texts)
    system, requirements = texts
    reference = f"{system}:SYSTEM" if python else system
    commands = (f"run {reference}", f"compare {reference} --trials 50", f"verify {requirements}")
    tell(system=system, requirements=requirements, next=[f"quietfix {command}" for command in commands])
    if asked_for_json():
        return
    say(f"{system}: a system to be changed; {requirements}: what it must show. Next:")
    for command in commands:
        say(f"  quietfix {command}")


def new_files(name: str, template: str = TEMPLATES[0], python: bool = False) -> dict[str, str]:
    """Return names and texts of the files of a new system: the system, and its requirements.

    Parameters
    ----------
    name : str
        Of the system; letters, digits, ``_`` and ``-``.
    template : str
        One of `TEMPLATES`.
    python : bool
        A module instead of a YAML file; its template is its own.

    Raises
    ------
    UserError
        For a name that is not allowed, and a template that is not there.
    """
    _check(name, python)
    system = f"{name}.py" if python else f"{name}.yaml"
    stem = "system" if python else choose("--template", template, TEMPLATES)
    sources = {system: f"{stem}.py.txt" if python else f"{stem}.yaml", f"{name}.requirements.yaml": None}
    folder = files("quietfix.diagrams.commands") / "templates"
    texts = {}
    for file, source in sources.items():
        text = (folder / (source or f"{stem}.requirements.yaml")).read_text(encoding="utf-8")
        texts[file] = text.replace("NAME", name)
    return texts


def _check(name: str, python: bool) -> None:
    if not _NAME.fullmatch(name):
        end = next((suffix for suffix in (".yaml", ".yml", ".py") if name.endswith(suffix)), "")
        hint = f"; without {end}" if _NAME.fullmatch(name.removesuffix(end)) and end else ""
        raise UserError(f"NAME: {name!r} is not allowed; {_WORDS}{hint}")
    if not python:
        return
    if not name.isidentifier() or keyword.iskeyword(name):
        raise UserError(f"NAME: {name!r} is not allowed with --python; letters, digits and _, no word of Python")
    found = None if Path(f"{name}.py").exists() else find_spec(name)
    if found is not None and found.origin is not None:  # None: a folder, of results, say
        raise UserError(f"NAME: {name} is not allowed with --python; it would hide the module of that name")


def _write(texts: Mapping[str, str]) -> None:
    """Write files of the current folder, all or none, and none over another."""
    for file in texts:
        if os.path.lexists(file):
            raise UserError(f"NAME: {file} is there already and is left as it is; choose another name")
    beside = {file: f".{file}.{os.getpid()}" for file in texts}
    done: list[str] = []
    try:
        with undisturbed():
            for file, text in texts.items():
                with open(beside[file], "x", encoding="utf-8") as stream:
                    stream.write(text)
            for file in texts:
                _place(beside[file], file)
                done.append(file)
    except BaseException as error:
        for file in done:
            os.unlink(file)
        if isinstance(error, FileExistsError):
            raise UserError(
                f"NAME: {error.filename2 or error.filename} is there already; choose another name"
            ) from error
        if isinstance(error, OSError):
            raise UserError(f"NAME: {error.filename} cannot be written ({error.strerror or error})") from error
        raise
    finally:
        for file in beside.values():
            with suppress(OSError):
                os.unlink(file)


def _place(written: str, file: str) -> None:
    """Give a file its name, if that is free: a rename would take it from one that somebody has made meanwhile."""
    try:
        os.link(written, file)
    except FileExistsError:
        raise
    except OSError:  # a file system without hard links
        os.close(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL))
        os.replace(written, file)
