"""Scenarios: typed YAML in, dataclasses out, and back as commented YAML.

A scenario is a dataclass loaded by ``pydrake.common.yaml``. Before that, `check` walks the data beside the
schema, so that a mistake is reported as field, value and what is allowed.
"""

from __future__ import annotations

import copy
import dataclasses
import math
import types
import typing
from collections.abc import Iterable, Mapping
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.common.yaml import yaml_dump, yaml_load_typed

from diagrams.schema.errors import UserError, choose, shown
from diagrams.schema.yaml_text import LONGEST, BadYaml, load_yaml
from systems.documented import Allowed, refusal
from systems.files import Unreadable, read_text

__all__ = ["apply_setting", "check", "check_object", "dump", "load", "merge", "natural_name", "read_yaml"]

_TAG = "_tag"
_KEYWORDS = {"class": "class_"}  # fields whose natural name is a Python keyword
_PRIMITIVES = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}


def read_yaml(source: Path | str, what: str = "scenario file") -> dict[str, Any]:
    """Read a YAML mapping from a file (Path) or a text (str), tags kept as ``_tag``; `what` it is, for messages.

    Raises
    ------
    UserError
        If the file is missing or unreadable, not a YAML mapping, or too large.
    """
    where = shown(source) if isinstance(source, Path) else "scenario"
    try:
        text = read_text(source, LONGEST) if isinstance(source, Path) else source
    except Unreadable as error:
        raise UserError(f"{what}: {where} cannot be read ({error.reason})") from error
    try:
        data = load_yaml(text)
    except BadYaml as error:
        if isinstance(source, Path) and error.line is not None:
            raise UserError(f"{where}:{error.line}: the {what} {error}") from error
        raise UserError(f"{what}: {where} {error}") from error
    if data is None:
        return {}
    if not isinstance(data, dict):
        raise UserError(f"{what}: {where} holds {type(data).__name__}; a mapping is needed")
    dated: dict[str, Any] = _dates_as_text(data)
    return dated


def _dates_as_text(data: Any) -> Any:
    """Return data whose dates, which YAML reads without being asked to, are texts again (ISO 8601)."""
    if isinstance(data, Mapping):
        return {key: _dates_as_text(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_dates_as_text(item) for item in data]
    return data.isoformat() if isinstance(data, date) else data


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Lay one mapping over another: mappings merge, all else (and a mapping of another tag) replaces."""
    merged = dict(base)
    for key, value in over.items():
        old = merged.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping) and value.get(_TAG, old.get(_TAG)) == old.get(_TAG):
            merged[key] = merge(old, value)
        else:
            merged[key] = copy.deepcopy(value)
    return merged


def apply_setting(data: Mapping[str, Any], setting: str) -> dict[str, Any]:
    """Apply one ``KEY=VALUE`` of the command line; the key is a dotted path, the value YAML.

    Raises
    ------
    UserError
        If there is no ``=`` or the value is not valid YAML.
    """
    key, equals, value = setting.partition("=")
    if not equals or not key.strip():
        raise UserError(f"--set: {setting!r} is not allowed; KEY=VALUE, such as truth.sigma_tdoa_ns=30")
    try:
        read = read_yaml(f"value: {value}")
    except UserError as error:
        reason = str(error.__cause__ or error)
        raise UserError(f"--set: {setting!r:.200} {reason}") from error
    if list(read) != ["value"]:
        raise UserError(f"--set: {setting!r:.200} is not allowed; one value, such as truth.sigma_tdoa_ns=30")
    return _set_path(data, key.strip().split("."), read["value"])


def _set_path(data: Any, path: list[str], value: Any) -> Any:
    head, rest = path[0], path[1:]
    if isinstance(data, list):
        if not head.isdigit() or int(head) >= len(data):
            raise UserError(f"--set: {head} is not an index of a list of {len(data)}")
        items = list(data)
        items[int(head)] = _set_path(items[int(head)], rest, value) if rest else value
        return items
    copied = dict(data) if isinstance(data, Mapping) else {}
    copied[head] = _set_path(copied.get(head, {}), rest, value) if rest else value
    return copied


# ------------------------------------------------------------------------------------------------- checking


def check(schema: Any, data: Any, path: str = "") -> None:
    """Check data against a schema, field by field.

    Parameters
    ----------
    schema : type
        Dataclass or type annotation.
    data : Any
        What YAML gave.
    path : str
        Dotted path so far, for messages.

    Raises
    ------
    UserError
        Naming the field, the value and what is allowed.
    """
    options = _union(schema)
    if options is not None:
        if data is None and type(None) in options:
            return
        concrete = [option for option in options if option is not type(None)]
        check(_pick(concrete, data, path), _untagged(data), path)
    elif dataclasses.is_dataclass(schema):
        named = isinstance(data, Mapping) and data.get(_TAG) == "!" + getattr(schema, "__name__", "")
        _check_fields(schema, _untagged(data) if named else data, path)
    elif typing.get_origin(schema) is list:
        if not isinstance(data, list):
            raise UserError(f"{path}: {data!r} is not allowed; a list")
        for i, item in enumerate(data):
            check(typing.get_args(schema)[0], item, f"{path}.{i}")
    elif typing.get_origin(schema) is dict:
        if not isinstance(data, Mapping):
            raise UserError(f"{path}: {data!r} is not allowed; a mapping")
        for key, item in data.items():
            if not isinstance(key, str) or not key:
                given = _scalar(key) if key != "" else "''"
                raise UserError(f"{path}: the name {given} is not allowed; text (a number in quotes)")
            if key in (_TAG, *_KEYWORDS, *_KEYWORDS.values()):
                raise UserError(f"{path}: the name {key} is not allowed; another one, for that is a word of Python")
            check(typing.get_args(schema)[1], item, f"{path}.{key}")
    else:
        _check_primitive(schema, data, path)


def check_object(schema: Any, scenario: Any) -> None:
    """Check a scenario that a user made or changed in Python, as `check` does what YAML gave.

    Raises
    ------
    UserError
        If it is not of that class, or naming the field, the value and what is allowed.
    """
    if not isinstance(scenario, schema):
        raise UserError(
            f"scenario: {type(scenario).__name__} is not allowed; a path, or an object that "
            f"{schema.__module__}.{schema.__qualname__} makes"
        )
    check(schema, _as_data(scenario))


def _as_data(value: Any) -> Any:
    """Return what YAML would have given for an object."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {natural_name(one.name): _as_data(getattr(value, one.name)) for one in dataclasses.fields(value)}
        return {_TAG: "!" + type(value).__name__, **fields}
    if isinstance(value, Mapping):
        return {key: _as_data(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_as_data(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _union(schema: Any) -> tuple[Any, ...] | None:
    if typing.get_origin(schema) in (typing.Union, types.UnionType):
        return typing.get_args(schema)
    return None


def _untagged(data: Any) -> Any:
    if isinstance(data, Mapping):
        return {key: value for key, value in data.items() if key != _TAG}
    return data


def _pick(options: list[Any], data: Any, path: str) -> Any:
    """Return which option of a union the data means: by tag, else the first that fits."""
    if isinstance(data, Mapping):
        tags: dict[str, Any] = {getattr(option, "__name__", ""): option for option in options}
        tag = data.get(_TAG)
        if tag is None:
            return next(iter(tags.values()), options[0])
        if not isinstance(tag, str):
            raise UserError(f"{path}.{_TAG}: {tag!r} is not allowed; a tag such as !{next(iter(tags))}")
        return tags[choose(path, "!" + tag.lstrip("!"), ["!" + name for name in tags])[1:]]
    for option in options:
        if option in _PRIMITIVES and type(data) is option:
            return option
    return options[0]


def _check_fields(schema: Any, data: Any, path: str) -> None:
    if not isinstance(data, Mapping):
        raise UserError(f"{path or 'scenario'}: {data!r} is not allowed; a mapping of fields")
    fields = {field.name: field for field in dataclasses.fields(schema)}
    shown = {natural_name(name): name for name in fields}
    for key, value in data.items():
        name = shown[choose(f"{path}." * bool(path) + str(key), str(key), shown)] if key not in shown else shown[key]
        here = f"{path}.{key}" if path else str(key)
        field = fields[name]
        check(field.type, value, here)
        _check_value(field.type, value, here, name, field.metadata.get("allowed"))


def _check_value(schema: Any, value: Any, path: str, name: str, allowed: Allowed | None) -> None:
    """Check a value of the right type against what its field allows; the numbers of a list each."""
    kinds = _union(schema) or (schema,)
    if value is None:
        return
    if isinstance(value, list):
        inner = next((typing.get_args(kind)[0] for kind in kinds if typing.get_origin(kind) is list), None)
        for i, item in enumerate(value):
            _check_value(inner, item, f"{path}.{i}", name, allowed)
        return
    # of a field that may be text, too, only what is a number is one
    reads_as_number = float in kinds and (str not in kinds or isinstance(value, float))
    number = _finite(value) if reads_as_number and not isinstance(value, bool) else value
    words = refusal(number, name, allowed)
    if words is not None:
        raise UserError(f"{path}: {value!r} is not allowed; {words}")


def _finite(value: Any) -> float:
    """Return a number; one that is too large for a float is infinite."""
    try:
        return float(value)
    except OverflowError:
        return math.inf


def natural_name(name: str) -> str:
    """Return the name of a field as a user writes it."""
    return next((plain for plain, safe in _KEYWORDS.items() if safe == name), name)


def _check_primitive(schema: Any, data: Any, path: str) -> None:
    good = {
        bool: isinstance(data, bool),
        int: isinstance(data, int) and not isinstance(data, bool),
        float: isinstance(data, int | float) and not isinstance(data, bool),
        str: isinstance(data, str),
    }
    if schema is float and isinstance(data, str):
        try:  # YAML 1.1 reads 1e-3 as text
            float(data)
        except ValueError:
            pass
        else:
            return
    if not good.get(schema, True):
        raise UserError(f"{path}: {data!r} is not allowed; {_PRIMITIVES[schema]}")


# ----------------------------------------------------------------------------------------- loading, printing


def load(schema: Any, layers: Iterable[Mapping[str, Any]]) -> Any:
    """Lay mappings over the schema's defaults, check them and load the dataclass.

    Raises
    ------
    UserError
        As `check`.
    """
    data: dict[str, Any] = {}
    for layer in layers:
        data = merge(data, layer)
    check(schema, data)
    text = yaml_dump(_safe_names(data))
    try:
        scenario = yaml_load_typed(schema=schema, data=text, retain_map_defaults=False)
    except Exception as error:  # `check` should have seen it; never show a traceback for a user's file
        raise UserError(f"scenario: {' '.join(str(error).split())}") from error
    _restore_order(scenario, data)
    return scenario


def _restore_order(loaded: Any, data: Mapping[str, Any]) -> None:
    """Put the keys of mappings back into the order of the file: the dump in between has sorted them."""
    for field in dataclasses.fields(loaded):
        value, source = getattr(loaded, field.name), data.get(natural_name(field.name))
        if isinstance(value, dict) and isinstance(source, Mapping):
            setattr(loaded, field.name, {key: value[key] for key in source if key != _TAG})
        _restore_inner(value, source)


def _restore_inner(value: Any, source: Any) -> None:
    """Do the same in what a field holds."""
    if dataclasses.is_dataclass(value) and isinstance(source, Mapping):
        _restore_order(value, source)
    elif isinstance(value, dict) and isinstance(source, Mapping):
        for key, item in value.items():
            _restore_inner(item, source[key])
    elif isinstance(value, list) and isinstance(source, list):
        for item, of in zip(value, source, strict=True):
            _restore_inner(item, of)


def _safe_names(data: Any) -> Any:
    if isinstance(data, Mapping):
        return {_KEYWORDS.get(key, key): _safe_names(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_safe_names(item) for item in data]
    return data


def dump(scenario: Any, comments: bool = True) -> str:
    """Return a scenario dataclass as YAML, with each field's meaning behind it."""
    lines: list[str] = []
    _dump_fields(scenario, 0, comments, lines)
    return "\n".join(lines) + "\n"


def _dump_fields(value: Any, depth: int, comments: bool, lines: list[str]) -> None:
    pad = "  " * depth
    for field in dataclasses.fields(value):
        item = getattr(value, field.name)
        doc = field.metadata.get("doc", "") if comments else ""
        note = f"  # {doc}" if doc else ""
        _dump_item(f"{pad}{natural_name(field.name)}:", item, depth, comments, note, lines, field.type)


def _dump_item(head: str, item: Any, depth: int, comments: bool, note: str, lines: list[str], kind: Any = None) -> None:
    pad = "  " * depth
    if dataclasses.is_dataclass(item):
        options = _union(kind) or ()
        concrete = [option for option in options if option is not type(None)]
        tag = f" !{type(item).__name__}" if len(concrete) > 1 else ""
        if not dataclasses.fields(item):
            lines.append(f"{head}{tag} {{}}{note}")
            return
        lines.append(f"{head}{tag}{note}")
        _dump_fields(item, depth + 1, comments, lines)
    elif isinstance(item, Mapping):
        lines.append(f"{head}{note}" if item else f"{head} {{}}{note}")
        inner = typing.get_args(kind)[1] if typing.get_args(kind) else None
        for key, value in item.items():
            _dump_item(f"{pad}  {_scalar(key)}:", value, depth + 1, comments, "", lines, inner)
    elif isinstance(item, list) and any(dataclasses.is_dataclass(part) for part in item):
        lines.append(f"{head}{note}")
        inner = typing.get_args(kind)[0]
        for part in item:
            _dump_item(f"{pad}-", part, depth, comments, "", lines, inner)
    else:
        lines.append(f"{head} {_scalar(item)}{note}")


def _scalar(item: Any) -> str:
    if item is None:
        return "null"
    if isinstance(item, bool):
        return "true" if item else "false"
    if isinstance(item, float):
        # YAML 1.1 needs a dot in 1.0e-10.
        shown = repr(item)
        return shown if "." in shown or "e" not in shown else shown.replace("e", ".0e")
    if isinstance(item, list):
        return "[" + ", ".join(_scalar(part) for part in item) + "]"
    if isinstance(item, str):
        plain = item.replace("_", "").replace("-", "").isalnum() and item[:1].isalpha()
        if plain and item.lower() not in ("true", "false", "null", "yes", "no", "on", "off", "y", "n"):
            return item
        if item.isprintable():
            return "'" + item.replace("'", "''") + "'"
        safe = (c if c.isprintable() and c not in '"\\' else f"\\U{ord(c):08x}" for c in item)
        return '"' + "".join(safe) + '"'
    return str(item)
