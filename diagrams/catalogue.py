"""Which systems and variants there are, and how a scenario is put together from its layers."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from diagrams.errors import UserError, choose, texts
from systems.registry import ESTIMATORS, locate

__all__ = [
    "SYSTEMS",
    "estimator_key",
    "load_scenario",
    "resolve_scenario",
    "select_estimators",
    "split_name",
    "system",
    "systems",
    "variants",
]

SYSTEMS: dict[str, str] = {
    "three_satellite": "diagrams.three_satellite:SYSTEM",
    "bearing_crossing": "diagrams.bearing_crossing:SYSTEM",
    "beacon_rocket": "diagrams.beacon_rocket:SYSTEM",
    "satellite_ranging": "diagrams.satellite_ranging:SYSTEM",
    "dual_satellite": "diagrams.dual_satellite:SYSTEM",
}
"""Where each system is, as ``module:NAME``; a new system is one line here."""

_NAME = re.compile(r"[^\W_][\w+-]{0,59}")  # it names blocks, signals, figures' labels and fields of `--set`
_MOST_EPOCHS = 1_000_000  # hours for one trial and one filter


def systems() -> list[str]:
    """Return the names of the systems."""
    return list(SYSTEMS)


def system(name: str) -> Any:
    """Return the `System` of that name.

    Raises
    ------
    UserError
        If there is none.
    """
    return locate(SYSTEMS[choose("system", name, SYSTEMS)])


def _folder() -> Path:
    return Path(str(files("diagrams"))) / "scenarios"


def variants(name: str) -> list[str]:
    """Return the names of a system's variants."""
    return sorted(path.name.split(".")[1] for path in _folder().glob(f"{name}.*.yaml"))


def split_name(name: str) -> tuple[str, str | None]:
    """Split ``SYSTEM`` or ``SYSTEM:VARIANT`` and check both parts."""
    if not isinstance(name, str):
        choose("system", name, SYSTEMS)
    head, colon, variant = name.partition(":")
    choose("system", head, SYSTEMS)
    if not colon:
        return head, None
    return head, choose(f"variant of {head}", variant, variants(head))


def load_scenario(
    name: str,
    variant: str | None = None,
    file: Path | str | None = None,
    settings: Sequence[str] = (),
    text: str | None = None,
    trust: bool = False,
) -> Any:
    """Return the scenario: packaged values, then the variant's, a user's file, and settings.

    Parameters
    ----------
    name : str
        System.
    variant : str, optional
        Variant of the system.
    file : path, optional
        A user's YAML; what it does not say stays as packaged.
    settings : sequence of str
        ``KEY=VALUE``, dotted.
    text : str, optional
        A whole scenario as text, instead of the packaged ones (a result carries its own).
    trust : bool
        Whether `text` may name classes, which are imported when the scenario is wired.

    Returns
    -------
    dataclass
        The system's scenario.

    Raises
    ------
    UserError
        Naming the field, the value and what is allowed, or a class that the text names without `trust`.
    """
    from diagrams.scenario import apply_setting, load, merge, read_yaml

    settings = texts("set", settings)
    schema = system(name).scenario
    if text is not None:
        data = read_yaml(text)
        if not trust:
            _refuse_classes(load(schema, [data]))
    else:
        data = read_yaml(_folder() / f"{name}.yaml")
        if variant is not None:
            choose(f"variant of {name}", variant, variants(name))
            data = merge(data, read_yaml(_folder() / f"{name}.{variant}.yaml"))
    if file is not None:
        data = merge(data, read_yaml(Path(file)))
    for setting in settings:
        data = apply_setting(data, setting)
    scenario = load(schema, [data])
    _check_sense(scenario)
    return scenario


def resolve_scenario(name: str, variant: str | None, scenario: Any, settings: Any) -> Any:
    """Return the scenario of a study: loaded, or a user's object, checked.

    Parameters
    ----------
    name, variant
        System and variant, checked.
    scenario : path, str, dataclass or None
        A user's YAML file, a whole scenario object, or nothing.
    settings : sequence of str, mapping or None
        ``KEY=VALUE``, or values by dotted key.

    Raises
    ------
    UserError
        Naming the field, the value and what is allowed.
    """
    from diagrams.scenario import check_object

    if isinstance(settings, Mapping):
        settings = [f"{key}={'null' if value is None else value}" for key, value in settings.items()]
    settings = texts("set", settings)
    if scenario is None or isinstance(scenario, str | Path):
        return load_scenario(name, variant, scenario, settings)
    check_object(system(name).scenario, scenario)
    if settings:
        raise UserError("set: it cannot be combined with a scenario object; change its fields instead")
    _check_sense(scenario)
    return scenario


def _check_sense(scenario: Any) -> None:
    """Check what the types of the fields do not say."""
    _check_epochs(scenario)
    for name in scenario.estimators:
        if not _NAME.fullmatch(name):
            raise UserError(
                f"estimators: the name {name!r} is not allowed; letters, digits, _, - and +, the first a letter or "
                "digit, at most 60"
            )


def _refuse_classes(scenario: Any) -> None:
    from systems.estimators.custom import Custom

    for where, part in _parts(scenario, ""):
        if isinstance(part, Custom):
            raise UserError(
                f"{where}.class: {part.class_} is code that the result names, and is not imported; add --trust if you "
                "know it"
            )


def _parts(value: Any, where: str) -> Iterator[tuple[str, Any]]:
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
        yield from _parts(item, f"{where}.{key}" if where else str(key))


def _check_epochs(scenario: Any) -> None:
    """Refuse a run that would hardly end; every system has a period, and an end of one of two names."""
    end = "stop_s" if hasattr(scenario, "stop_s") else "duration_s"
    longest = _MOST_EPOCHS * scenario.period_s + getattr(scenario, "start_s", 0.0)
    if getattr(scenario, end) > longest:
        raise UserError(
            f"{end}: {getattr(scenario, end):g} is not allowed; at most {longest:g}, {_MOST_EPOCHS} epochs of period_s "
            f"{scenario.period_s:g}"
        )


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
            scenario.estimators[name] = locate(ESTIMATORS[name])()
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
                scenario.estimators[key] = locate(ESTIMATORS["custom"])(class_=name)
            chosen.append(key)
        else:
            known = dict.fromkeys([*scenario.estimators, *(e for e in ESTIMATORS if e != "custom")])
            choose("estimator", name, known)
    return list(dict.fromkeys(chosen))
