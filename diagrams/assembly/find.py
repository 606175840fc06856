"""Where systems are: the only place that knows. By name, in a module, in a file, in an installed package."""

from __future__ import annotations

import hashlib
import os
import re
import sys
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from quietfix.diagrams.assembly.model import Model
from quietfix.diagrams.assembly.source import blaming, import_file, import_module
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.schema.errors import UserError, choose, in_users_words, shown
from quietfix.diagrams.schema.origins import origins_of
from quietfix.systems.files import Unreadable, read_bytes
from quietfix.systems.registry import in_one_line, object_at

__all__ = ["FORMS", "GROUP", "PACKAGED", "RECORDINGS", "Found", "find", "fingerprint_of", "read_own", "systems"]

PACKAGED: dict[str, str] = {
    "three_satellite": "quietfix.diagrams.library.three_satellite:SYSTEM",
    "bearing_crossing": "quietfix.diagrams.library.bearing_crossing:SYSTEM",
    "beacon_rocket": "quietfix.diagrams.library.beacon_rocket:SYSTEM",
    "satellite_ranging": "quietfix.diagrams.library.satellite_ranging:SYSTEM",
    "dual_satellite": "quietfix.diagrams.library.dual_satellite:SYSTEM",
}
"""Where each system that comes with Quietfix is, as ``module:NAME``; a new one is one line here."""

RECORDINGS: dict[str, str] = {
    "locards": "quietfix.diagrams.recorded.locards:SYSTEM",
    "doptrack": "quietfix.diagrams.recorded.doptrack:SYSTEM",
    "kiwisdr": "quietfix.diagrams.recorded.kiwisdr:SYSTEM",
    "bearings": "quietfix.diagrams.recorded.bearings:SYSTEM",
    "iq": "quietfix.diagrams.recorded.iq:SYSTEM",
}
"""Where each recording is; likewise."""

GROUP = "quietfix.systems"
"""Entry points of installed packages: a system's name, and where it is, as ``package.module:OBJECT``."""

FORMS = "or package.module:OBJECT, FILE.py:OBJECT or FILE.yaml for one of your own"

_OURS = {**PACKAGED, **RECORDINGS}
_OWN = "quietfix.diagrams.own.system:own_system"  # named, not imported: the room of the systems is above this one

_PYTHON_FILE = re.compile(r"(?P<file>.+\.py)(?::(?P<object>[^:]*))?(?::(?P<variant>[^:]*))?", re.DOTALL)
_YAML_FILE = re.compile(r"(?P<file>.+\.ya?ml)(?::(?P<variant>[^:]*))?", re.DOTALL)
_MODULE = re.compile(r"(?P<module>[^\W\d]\w*(?:\.[^\W\d]\w*)*):(?P<object>[^:]*)(?::(?P<variant>[^:]*))?")


@dataclass(frozen=True)
class Found:
    """A system, and where it is.

    Attributes
    ----------
    system : System
        The system.
    variant : str or None
        Which of its variants.
    reference : str
        What finds it again, without the variant; its name, where nothing does.
    source : {'packaged', 'installed', 'module', 'file', 'yaml', 'object'}
        What kind of reference it is; ``object``: a Python object that no module has.
    place : Path or None
        The file it is written in, of one that is not packaged.
    fingerprint : str
        ``sha256:`` and the digest of that file as it was read; empty where there is none.
    beside : tuple of Path
        Files in its folder that it imports.
    """

    system: System
    variant: str | None
    reference: str
    source: str
    place: Path | None = None
    fingerprint: str = ""
    beside: tuple[Path, ...] = ()

    @property
    def title(self) -> str:
        """Reference and variant, as on the command line."""
        return f"{self.reference}:{self.variant}" if self.variant else self.reference

    @property
    def slug(self) -> str:
        """Name and variant, for files."""
        return f"{self.system.name}_{self.variant}" if self.variant else self.system.name

    @property
    def attributes(self) -> dict[str, str]:
        """What a result says of where its system came from; nothing of a packaged one."""
        if self.source == "packaged":
            return {}
        place = {} if self.place is None else {"system_file": str(self.place)}
        return {"system_source": self.source, **place, "system_fingerprint": self.fingerprint}

    def blaming(self, estimators: Mapping[str, Any], title: str = "") -> AbstractContextManager[None]:
        """Turn whatever a user's own code raises, in a class or in the system, into a `UserError` that names it.

        Parameters
        ----------
        estimators : mapping of str to EstimatorOptions
            Those of the scenario.
        title : str
            What the message begins with; by default the system.
        """
        title = title or (shown(self.place) if self.source == "yaml" and self.place else self.title)
        return blaming(title, self.place, self.source != "packaged", estimators)

    def model(self, scenario: Any) -> Model:
        """Return what a scenario declares, once for all diagrams of it.

        Raises
        ------
        UserError
            If something does not fit, or the system's own code fails.
        """
        with origins_of(scenario).placing(), in_users_words(), self.blaming(scenario.estimators):
            return self.system.model(scenario)

    def of(self, variant: str | None) -> Found:
        """Return another variant of it; None: the same.

        Raises
        ------
        UserError
            If there is none of that name.
        """
        if variant is None:
            return self
        return replace(self, variant=choose(f"variant of {self.reference}", variant, sorted(self.system.variants)))


def systems() -> list[str]:
    """Return the names of what is simulated: the packaged systems, and those of installed packages."""
    return [*PACKAGED, *(name for name in _installed() if name not in _OURS)]


def find(reference: str | System | Found, variant: str | None = None, folder: Path | None = None) -> Found:
    """Return the system that a reference names.

    Parameters
    ----------
    reference : str, System or Found
        ``NAME[:VARIANT]`` of a packaged system or of one of an installed package's entry points `GROUP`,
        ``package.module:OBJECT[:VARIANT]``, ``FILE.py:OBJECT[:VARIANT]``, ``FILE.yaml[:VARIANT]``, or the object.
    variant : str, optional
        Goes before that of the reference.
    folder : Path, optional
        What files are relative to; by default the current folder.

    Raises
    ------
    UserError
        If there is no such name, file, module, object or variant, if a file fails while it is read, or if what is there
        is no `System`.
    """
    if isinstance(reference, Found):
        return reference.of(variant)
    if isinstance(reference, System):
        return _placed(reference).of(variant)
    if not isinstance(reference, str):
        choose("system", reference, [*systems(), *RECORDINGS])
    head, _, tail = reference.partition(":")
    if head in _OURS:
        found = Found(object_at(_OURS[head]), None, head, "packaged")
        return found.of(variant or (tail if ":" in reference else None))
    if match := _PYTHON_FILE.fullmatch(reference):
        found = _in_file(match["file"], match["object"], folder or Path())
    elif match := _YAML_FILE.fullmatch(reference):
        found = _yaml(match["file"], folder or Path())
    elif head in _installed():
        return _entry(_installed()[head]).of(variant or (tail if ":" in reference else None))
    elif (match := _MODULE.fullmatch(reference)) and _is_there(match["module"]):
        found = _in_module(match["module"], match["object"])
    else:
        raise _unknown(head, reference)
    return found.of(variant or match["variant"])


def _unknown(head: str, reference: str) -> UserError:
    try:
        choose("system", head, [*systems(), *RECORDINGS])
    except UserError as error:
        module = f"; there is no module {head}" if ":" in reference and "." in head else ""
        return UserError(f"{error}; {FORMS}{module}")
    raise AssertionError(head)


# ------------------------------------------------------------------------------------------------- references


def _in_file(file: str, name: str | None, folder: Path) -> Found:
    path = Path(os.path.realpath(folder / file))  # unlike `resolve`, of a link to itself, too
    module, fingerprint = import_file(path, file)
    return Found(_object(module, file, name), None, f"{file}:{name}", "file", path, fingerprint, _beside(module))


def _in_module(module: str, name: str) -> Found:
    imported = import_module(module)
    place = _file(imported)
    return Found(_object(imported, module, name), None, f"{module}:{name}", "module", place, fingerprint_of(place))


def _yaml(file: str, folder: Path) -> Found:
    path = Path(os.path.realpath(folder / file))  # unlike `resolve`, of a link to itself, too
    try:
        fingerprint = _digest(read_bytes(path))
    except Unreadable as error:
        raise UserError(f"system: {file} cannot be read ({error.reason})") from error
    return Found(read_own(path), None, file, "yaml", path, fingerprint)


def read_own(path: Path, text: str | None = None) -> System:
    """Return the system that a YAML file describes; `text`: what is in it, where a result says it.

    Raises
    ------
    UserError
        Naming the field, the value and what is allowed.
    """
    system = object_at(_OWN)(path, text)
    assert isinstance(system, System)
    return system


def _entry(entry: EntryPoint) -> Found:
    try:
        found = _in_module(entry.module, entry.attr)
    except UserError as error:
        package = entry.dist.name if entry.dist else "an installed package"
        raise UserError(f"system: {entry.name}, of {package}: {error}") from error
    return replace(found, reference=entry.name, source="installed")


def _installed() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def _is_there(module: str) -> bool:
    """Return whether a module is loaded, or its outermost package can be found; nothing is imported."""
    try:
        return module in sys.modules or find_spec(module.partition(".")[0]) is not None
    except (ImportError, ValueError):
        return False


def _object(module: ModuleType, where: str, name: str | None) -> System:
    """Return the system of that name in a module."""
    there = sorted(key for key, value in vars(module).items() if isinstance(value, System))
    if not name:
        raise UserError(f"system: {where}: which object in it? {where}:OBJECT; there are {', '.join(there) or 'none'}")
    try:
        found = getattr(module, name)
    except AttributeError:
        choose(f"system in {where}", name, there)
        raise
    except Exception as error:  # a module may have a __getattr__ of its own
        raise UserError(f"system: {where}:{name}: {in_one_line(error)}") from error
    if not isinstance(found, System):
        kind = "class" if isinstance(found, type) else type(found).__name__
        raise UserError(
            f"system: {where}:{name} is not allowed; it is of type {kind}, an object of quietfix.System is needed; "
            f"there are {', '.join(there) or 'none'}"
        )
    return found


# ---------------------------------------------------------------------------------------------------- objects


def _placed(system: System) -> Found:
    """Return an object with the reference that finds it again, if there is one."""
    if system.file is not None:
        return Found(system, None, str(system.file), "yaml", system.file.resolve(), fingerprint_of(system.file))
    for module in _modules(system):
        for name, value in list(vars(module).items()):
            if value is system:
                return _of_module(system, module, name)
    return Found(system, None, system.name, "object")


def _of_module(system: System, module: ModuleType, name: str) -> Found:
    for packaged, path in _OURS.items():
        if path == f"{module.__name__}:{name}":
            return Found(system, None, packaged, "packaged")
    place = _file(module)
    fingerprint = getattr(module, "__fingerprint__", None) or fingerprint_of(place)
    if hasattr(module, "__fingerprint__") or module.__name__ == "__main__":
        if place is None:
            return Found(system, None, system.name, "object")
        return Found(system, None, f"{place}:{name}", "file", place, fingerprint, _beside(module))
    return Found(system, None, f"{module.__name__}:{name}", "module", place, fingerprint)


def _modules(system: System) -> Iterator[ModuleType]:
    """Yield the modules that an object may be in, the likely ones first."""
    loaded = dict(sys.modules)
    likely = [getattr(what, "__module__", None) for what in (system.declare, system.scenario)]
    for name in dict.fromkeys([*likely, *loaded]):
        module: Any = loaded.get(str(name))
        if isinstance(module, ModuleType):
            yield module


def _beside(module: ModuleType) -> tuple[Path, ...]:
    return tuple(getattr(module, "__beside__", ()))


def _file(module: ModuleType) -> Path | None:
    file = getattr(module, "__file__", None)
    return Path(file).resolve() if file and Path(file).is_file() else None


def fingerprint_of(place: Path | None) -> str:
    """Return ``sha256:`` and the digest of a file; empty where it cannot be read."""
    try:
        return "" if place is None else _digest(read_bytes(place))
    except Unreadable:
        return ""


def _digest(content: bytes) -> str:
    return f"sha256:{hashlib.sha256(content).hexdigest()}"
