"""Which estimators of a scenario run, and what the scenario names that is code."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from quietfix.diagrams.schema.errors import UserError, choose, texts
from quietfix.systems.registry import ESTIMATORS, object_at

__all__ = ["check_names", "estimator_key", "parts_of", "refuse_classes", "select_estimators"]

_NAME = re.compile(r"[^\W_][\w+-]{0,59}")  # it names blocks, signals, figures' labels and fields of `--set`


def check_names(scenario: Any) -> None:
    """Check the names of the estimators.

    Raises
    ------
    UserError
        If there is no mapping of them, or one cannot name a block.
    """
    if not isinstance(scenario.estimators, Mapping):
        raise UserError(f"estimators: {scenario.estimators!r:.80} is not allowed; a mapping of options by name")
    for name in scenario.estimators:
        if not _NAME.fullmatch(name):
            raise UserError(
                f"estimators: the name {name!r} is not allowed; letters, digits, _, - and +, the first a letter or "
                "digit, at most 60"
            )


def refuse_classes(scenario: Any) -> None:
    """Refuse a scenario that names code: whatever in it has a field ``class``.

    Raises
    ------
    UserError
        Naming the class.
    """
    for where, part in parts_of(scenario):
        if dataclasses.is_dataclass(part) and hasattr(part, "class_"):
            raise UserError(
                f"{where}.class: {part.class_} is code that the result names, and is not imported; add --trust if you "
                "know it"
            )


def parts_of(value: Any, where: str = "") -> Iterator[tuple[str, Any]]:
    """Yield everything in a scenario with its dotted path."""
    yield where, value
    inner: Iterable[tuple[Any, Any]] = ()
    if dataclasses.is_dataclass(value):
        inner = ((field.name, getattr(value, field.name)) for field in dataclasses.fields(value))
    elif isinstance(value, Mapping):
        inner = value.items()
    elif isinstance(value, list):
        inner = enumerate(value)
    for key, item in inner:
        yield from parts_of(item, f"{where}.{key}" if where else str(key))


def estimator_key(name: str) -> str:
    """Return what a study calls an estimator that is asked for by name or by ``package.module:Class``."""
    return name.partition(":")[2].lower() if ":" in name else name


def select_estimators(scenario: Any, wanted: Sequence[str] | None) -> list[str]:
    """Return the estimators to run: all of the scenario, or those asked for.

    A name from the registry that the scenario lacks, and ``package.module:Class``, are added to the scenario with
    default options; ``default`` means all that the scenario has.

    Raises
    ------
    UserError
        For a name that is not known, and for a class whose name another estimator has.
    """
    wanted = texts("estimators", wanted)
    if not wanted:
        if not scenario.estimators:
            raise UserError("estimators: none is given; at least one is needed")
        return list(scenario.estimators)
    chosen: list[str] = []
    own = list(scenario.estimators)
    for name in wanted:
        if name == "default":
            chosen.extend(own)
        elif name in scenario.estimators:
            chosen.append(name)
        elif name in ESTIMATORS and name != "custom":
            scenario.estimators[name] = object_at(ESTIMATORS[name])()
            chosen.append(name)
        elif ":" in name:
            key = estimator_key(name)
            there = scenario.estimators.get(key)
            if key in ESTIMATORS or (there is not None and getattr(there, "class_", None) != name):
                raise UserError(
                    f"estimator: {name} is not allowed; it would be called {key}, which is another estimator's name: "
                    f"rename the class, or name it yourself by --set 'estimators.NAME=!Custom {{class: {name}}}'"
                )
            if there is None:
                scenario.estimators[key] = object_at(ESTIMATORS["custom"])(class_=name)
            chosen.append(key)
        else:
            known = dict.fromkeys([*scenario.estimators, *(e for e in ESTIMATORS if e != "custom")])
            choose("estimator", name, known)
    return list(dict.fromkeys(chosen))
