"""Which estimators of a scenario run, and what the scenario names that is code."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from quietfix.diagrams.schema.errors import UserError, choose, texts
from quietfix.systems.registry import ESTIMATORS, SMOOTHED, object_at

__all__ = ["check_names", "estimator_key", "parts_of", "refuse_classes", "select_estimators", "smoothers_of"]

_SMOOTHED = "_smoothed"
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
    default options; ``default`` means all that the scenario has. ``NAME_smoothed`` is the smoother of that one, and
    ``smoothed`` adds those of all others that are asked for and can be smoothed.

    Raises
    ------
    UserError
        For a name that is not known, for a class whose name another estimator has, and where nothing can be smoothed.
    """
    wanted = texts("estimators", wanted)
    if not wanted:
        if not scenario.estimators:
            raise UserError("estimators: none is given; at least one is needed")
        return list(scenario.estimators)
    own, every = list(scenario.estimators), "smoothed" in wanted and "smoothed" not in scenario.estimators
    chosen: list[str] = []
    for name in [one for one in wanted if not (every and one == "smoothed")] or ["default"]:
        chosen.extend(own if name == "default" else [_select(scenario, name)])
    return list(dict.fromkeys(chosen + (smoothers_of(scenario, chosen) if every else [])))


def smoothers_of(scenario: Any, chosen: Sequence[str]) -> list[str]:
    """Add the smoothers of all estimators of these that can be smoothed to a scenario, and return their names.

    Raises
    ------
    UserError
        If there are none.
    """
    able = object_at(SMOOTHED.replace("Smoothed", "can_be_smoothed"))
    found = [name for name in chosen if able(scenario.estimators[name])]
    if not found:
        raise UserError(
            f"smoothed: {', '.join(chosen)} cannot be smoothed; Kalman-type filters can: ekf, iekf, ukf, mgekf, or a "
            "GaussianFilter of yours"
        )
    return [_select(scenario, name + _SMOOTHED) for name in found]


def _select(scenario: Any, name: str) -> str:
    """Add one estimator to a scenario, if it is not there, and return what it is called."""
    if name in scenario.estimators:
        return name
    if name in ESTIMATORS and name != "custom":
        scenario.estimators[name] = object_at(ESTIMATORS[name])()
        return name
    if ":" in name:
        return _select_class(scenario, name)
    before = name.removesuffix(_SMOOTHED)
    if before != name and (before in scenario.estimators or before in ESTIMATORS):
        new = before not in scenario.estimators
        options = scenario.estimators[_select(scenario, before)]
        if new:
            del scenario.estimators[before]
        if not object_at(SMOOTHED.replace("Smoothed", "can_be_smoothed"))(options):
            raise UserError(f"estimator: {name} is not allowed; {before} is no Kalman-type filter, and has no smoother")
        scenario.estimators[name] = object_at(SMOOTHED)(filter=options)
        return name
    choose("estimator", name, dict.fromkeys([*scenario.estimators, *(e for e in ESTIMATORS if e != "custom")]))
    return name


def _select_class(scenario: Any, name: str) -> str:
    key = estimator_key(name)
    there = scenario.estimators.get(key)
    if key in ESTIMATORS or (there is not None and getattr(there, "class_", None) != name):
        raise UserError(
            f"estimator: {name} is not allowed; it would be called {key}, which is another estimator's name: "
            f"rename the class, or name it yourself by --set 'estimators.NAME=!Custom {{class: {name}}}'"
        )
    if there is None:
        scenario.estimators[key] = object_at(ESTIMATORS["custom"])(class_=name)
    return key
