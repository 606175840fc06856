"""A study again from its own result: everything that the result says is checked, and none of it names code."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from diagrams.catalogue import SYSTEMS, load_scenario, split_name, variants
from diagrams.errors import UserError, choose
from diagrams.results import find_store
from diagrams.store import read_attributes

__all__ = ["ask_again"]


def ask_again(path: Path, system: str | None, asked: Mapping[str, Any], trust: bool) -> tuple[str, dict[str, Any]]:
    """Return system and options of an earlier result, as `diagrams.study.Study` takes them.

    Parameters
    ----------
    path : Path
        The result.
    system : str, optional
        What the user names besides; it must be the result's.
    asked : mapping
        Options that go before those of the result.
    trust : bool
        Whether estimator classes that the result names may be imported.

    Raises
    ------
    UserError
        Naming the attribute, its value and what is allowed, or the class.
    """
    from diagrams.study import KEEP

    if "scenario" in asked:
        raise UserError("--scenario: it cannot be combined with --from; use --set")
    attributes = read_attributes(find_store(path))
    take = _Taker(path, attributes)
    name = take("system", lambda v: choose("system", v, SYSTEMS), "text", str)
    variant = take("variant", lambda v: v and choose(f"variant of {name}", v, variants(name)), "text", str) or None
    again: dict[str, Any] = {"variant": variant}
    for key, least in (("seed", 0), ("first_trial", 0), ("trials", 1), ("every", 1)):
        again[key] = take(key, _whole(key, least), f"a whole number >= {least}", int)
    again["keep"] = take("keep", lambda v: choose("keep", v, KEEP), "text", str)
    if system is not None:
        named, named_variant = split_name(system)
        if named != name or (named_variant is not None and named_variant != variant):
            whole = f"{name}:{variant}" if variant else name
            raise UserError(f"system: {system} is not that of --from {path}, which is {whole}")
    take("scenario", lambda v: load_scenario(name, text=v, trust=trust), "text", str)
    options = dict(asked)
    again["scenario"] = load_scenario(name, text=attributes["scenario"], settings=options.pop("set", []), trust=trust)
    return name, again | options


class _Taker:
    """Take attributes of a result one by one."""

    def __init__(self, path: Path, attributes: Mapping[str, Any]) -> None:
        self._path, self._attributes = path, attributes

    def __call__(self, key: str, check: Callable[[Any], Any], words: str, kind: type) -> Any:
        """Return what `check` makes of an attribute of the right type."""
        if key not in self._attributes:
            raise UserError(f"--from: {self._path}: {key}: it is missing; {words}")
        value = self._attributes[key]
        if type(value) is not kind:
            raise UserError(f"--from: {self._path}: {key}: {value!r:.80} is not allowed; {words}")
        try:
            return check(value)
        except UserError as error:
            raise UserError(f"--from: {self._path}: {error}") from error


def _whole(key: str, least: int) -> Callable[[int], int]:
    def check(value: int) -> int:
        if not least <= value < 2**53:
            raise UserError(f"{key}: {value!r:.80} is not allowed; a whole number from {least} to {2**53 - 1}")
        return value

    return check
