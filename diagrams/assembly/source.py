"""A user's Python source: imported, and, where it fails, named by file and line."""

from __future__ import annotations

import hashlib
import importlib
import os
import sys
import sysconfig
import traceback
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import quietfix.diagrams
import quietfix.systems
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.files import Unreadable, read_bytes
from quietfix.systems.options.custom import Custom
from quietfix.systems.registry import in_one_line

__all__ = ["beside", "blaming", "import_file", "import_module", "is_users", "line_of", "look_in"]

_INITS = [Path(str(package.__file__)) for package in (quietfix.diagrams, quietfix.systems)]
_OURS = tuple(str(folder) for file in _INITS for folder in (file.parent, file.resolve().parent))  # a link, and its end
_OTHERS = tuple(
    str(Path(sysconfig.get_path(name)).resolve()) for name in ("stdlib", "platstdlib", "purelib", "platlib")
)


_LOOKED_IN: dict[str, None] = {}  # folders of systems of YAML, the last one first


# -------------------------------------------------------------------------------------------------- importing


@contextmanager
def beside(folder: Path) -> Iterator[list[Path]]:
    """Make modules of a folder importable for a while; another folder's file may have the same name.

    Yields
    ------
    list of Path
        In the end, the files of the folder that were imported.
    """
    files: list[Path] = []
    path = str(folder.resolve())
    before = set(sys.modules)
    sys.path.append(path)
    try:
        yield files
    finally:
        sys.path.remove(path)
        fresh = set(sys.modules) - before
        tops = {name for name in fresh if "." not in name and _folder(sys.modules[name]) == path}
        for name in fresh:
            if name.partition(".")[0] in tops:
                file = getattr(sys.modules[name], "__file__", None)
                files += [Path(file)] if file else []
                del sys.modules[name]


def look_in(folder: Path) -> None:
    """Look for a user's modules in a folder from now on, before the current one and before other such folders.

    A module of another such folder is forgotten where this one has a file of its name.
    """
    path = str(folder.resolve())
    if path in sys.path and (path not in _LOOKED_IN or next(iter(_LOOKED_IN)) == path):
        return
    for name, module in list(sys.modules.items()):
        there = _folder(module) if "." not in name else None
        if there in _LOOKED_IN and there != path and ((folder / f"{name}.py").exists() or (folder / name).is_dir()):
            for own in [own for own in sys.modules if own.partition(".")[0] == name]:
                del sys.modules[own]
    others = [one for one in _LOOKED_IN if one != path]
    sys.path[:] = [one for one in sys.path if one != path]
    places = [sys.path.index(one) for one in ("", *others) if one in sys.path]
    sys.path.insert(min(places, default=len(sys.path)), path)
    _LOOKED_IN.clear()
    _LOOKED_IN.update(dict.fromkeys([path, *others]))


def _folder(module: ModuleType) -> str | None:
    """Return the folder that a module, or a package, is imported from."""
    file = getattr(module, "__file__", None)
    if not file:
        return None
    path = Path(file)
    return str((path.parent if path.stem == "__init__" else path).parent.resolve())


def import_file(path: Path, shown: str) -> tuple[ModuleType, str]:
    """Import a Python file as it is now, with the modules beside it; the same content is imported once.

    Parameters
    ----------
    path : Path
        The file.
    shown : str
        What the user calls it.

    Returns
    -------
    module : ModuleType
        Its attribute ``__fingerprint__`` is the second one.
    fingerprint : str
        ``sha256:`` and the digest of the file.

    Raises
    ------
    UserError
        If it cannot be read, or fails.
    """
    try:
        content = read_bytes(path)
    except Unreadable as error:
        raise UserError(f"system: {shown} cannot be read ({error.reason})") from error
    fingerprint = f"sha256:{hashlib.sha256(content).hexdigest()}"
    name = f"{path.stem}@{hashlib.sha256(f'{path}{fingerprint}'.encode()).hexdigest()[:16]}"
    if name in sys.modules:
        return sys.modules[name], fingerprint
    module = ModuleType(name)
    module.__file__ = str(path)
    module.__dict__["__fingerprint__"] = fingerprint
    sys.modules[name] = module  # dataclasses look their module up
    try:
        with beside(path.parent) as files:
            # not by a loader: its cache takes an edit within the same second for the file as it was
            exec(compile(content, str(path), "exec"), module.__dict__)
    except BaseException as error:
        del sys.modules[name]
        _blame_import(shown, error)
        raise
    module.__dict__["__beside__"] = files
    return module, fingerprint


def import_module(name: str) -> ModuleType:
    """Import a module by its dotted name.

    Raises
    ------
    UserError
        If it is not there, or fails.
    """
    try:
        return importlib.import_module(name)
    except BaseException as error:  # whatever a user's file does while it is read, sys.exit too
        _blame_import(name, error)
        raise


def _blame_import(shown: str, error: BaseException) -> None:
    if not isinstance(error, KeyboardInterrupt | MemoryError):
        words, line = in_one_line(error), line_of(error)
        # a syntax error says it by itself
        raise UserError(f"system: {shown} cannot be imported: {words.removesuffix(line)}{line}") from error


# ------------------------------------------------------------------------------------------- naming who failed


def line_of(error: BaseException, near: Path | None = None) -> str:
    """Return `` (FILE, line N)``: the innermost line of a user's code that an error went through; empty if none.

    Parameters
    ----------
    error : BaseException
        What was raised.
    near : Path, optional
        A file of the user's; its folder is the user's even where packages are installed.
    """
    if isinstance(error, SyntaxError) and error.filename and error.lineno:
        return f" ({Path(error.filename).name}, line {error.lineno})"
    for frame in reversed(traceback.extract_tb(error.__traceback__)):
        if is_users(frame.filename, near):
            return f" ({Path(frame.filename).name}, line {frame.lineno})"
    return ""


def is_users(file: str, near: Path | None = None) -> bool:
    """Return whether a file is a user's: not of Quietfix, and of no installed package but that of `near`."""
    if file.startswith("<") or _within(file, _OURS):
        return False
    if not _within(file, _OTHERS):
        return True
    return near is not None and _within(str(near), _OTHERS) and _within(file, [str(near.parent)])


def _within(file: str, folders: Sequence[str]) -> bool:
    return any(file.startswith(folder + os.sep) for folder in folders)


@contextmanager
def blaming(title: str, near: Path | None, users: bool, estimators: Mapping[str, Any]) -> Iterator[None]:
    """Turn whatever a user's own code raises, sys.exit too, into a `UserError` of one line that names it.

    Parameters
    ----------
    title : str
        What the system is called.
    near : Path, optional
        The file that it is in.
    users : bool
        Whether it is the user's own: then every error while it is built and run is told as one of it.
    estimators : mapping of str to EstimatorOptions
        Those of the scenario; a `Custom` one among them names its class.
    """
    try:
        yield
    except (KeyboardInterrupt, UserError):
        raise
    except BaseException as error:
        _blame_estimator(error, estimators)
        if not users or isinstance(error, MemoryError):
            raise
        raise UserError(f"{title}: {_words(error)}{line_of(error, near)}") from error


def _words(error: BaseException) -> str:
    """Return what an error says; a block of ours says what is wrong with its arguments in the user's words."""
    last = traceback.extract_tb(error.__traceback__)[-1].filename
    return str(error) if isinstance(error, ValueError) and _within(last, _OURS) else in_one_line(error)


def _blame_estimator(error: BaseException, estimators: Mapping[str, Any]) -> None:
    """Raise a `UserError` if a user's own estimator class failed: its block or file is on the way to it."""
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    # Drake reads any memory for the name of a block that is not there yet.
    unmade = {id(frame.f_locals.get("self")) for frame in frames if frame.f_code.co_name == "__init__"}
    for frame in frames:
        block = frame.f_locals.get("self")
        if not isinstance(block, Estimator) or id(block) in unmade:
            continue
        name = block.get_name()
        options = getattr(estimators.get(name), "plain", None)
        if isinstance(options, Custom):
            raise UserError(options.blame(name, error)) from error
    for name, given in estimators.items():
        options = getattr(given, "plain", None)
        if isinstance(options, Custom) and options.raised(error):
            raise UserError(options.blame(name, error)) from error
