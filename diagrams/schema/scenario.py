"""Scenarios: layers of YAML in, dataclasses out, and back as commented YAML."""

from __future__ import annotations

import copy
import dataclasses
import typing
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from quietfix.diagrams.schema.errors import UserError, shown
from quietfix.diagrams.schema.reading import fields_of, options_of, read
from quietfix.diagrams.schema.yaml_text import LONGEST, TAG, BadYaml, load_yaml, scalar_text
from quietfix.systems.files import Unreadable, read_text

__all__ = ["apply_setting", "check_object", "dump", "load", "merge", "read_yaml"]


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
    return data


def merge(base: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """Lay one mapping over another: mappings merge, all else (and a mapping of another tag) replaces."""
    merged = dict(base)
    for key, value in over.items():
        old = merged.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping) and value.get(TAG, old.get(TAG)) == old.get(TAG):
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


# ----------------------------------------------------------------------------------------- loading, printing


def load(schema: type, layers: Iterable[Mapping[str, Any]]) -> Any:
    """Lay mappings over the schema's defaults, check them field by field and make the dataclass of them.

    Raises
    ------
    UserError
        Naming the field, the value and what is allowed.
    """
    data: dict[str, Any] = {}
    for layer in layers:
        data = merge(data, layer)
    return read(schema, data)


def check_object(schema: type, scenario: Any) -> None:
    """Check a scenario that a user made or changed in Python, as `load` does what YAML gave.

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
    load(schema, [_as_data(scenario)])


def _as_data(value: Any) -> Any:
    """Return what YAML would have given for an object."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = fields_of(type(value))
        return {TAG: f"!{type(value).__name__}", **{key: _as_data(getattr(value, fields[key].name)) for key in fields}}
    if isinstance(value, Mapping):
        return {key: _as_data(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_as_data(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def dump(scenario: Any, comments: bool = True) -> str:
    """Return a scenario dataclass as YAML, with each field's meaning behind it."""
    lines: list[str] = []
    _dump_fields(scenario, 0, comments, lines)
    return "\n".join(lines) + "\n"


def _dump_fields(value: Any, depth: int, comments: bool, lines: list[str]) -> None:
    pad = "  " * depth
    for key, field in fields_of(type(value)).items():
        note = f"  # {field.doc}" if field.doc and comments else ""
        _dump_item(f"{pad}{key}:", getattr(value, field.name), depth, comments, note, lines, field.type)


def _dump_item(head: str, item: Any, depth: int, comments: bool, note: str, lines: list[str], kind: Any) -> None:
    pad = "  " * depth
    options = [option for option in options_of(kind) if option is not type(None)]
    inner = next((typing.get_args(option)[-1] for option in options if typing.get_args(option)), None)
    if dataclasses.is_dataclass(item):
        tag = f" !{type(item).__name__}" if len(options) > 1 else ""
        if not dataclasses.fields(item):
            lines.append(f"{head}{tag} {{}}{note}")
            return
        lines.append(f"{head}{tag}{note}")
        _dump_fields(item, depth + 1, comments, lines)
    elif isinstance(item, Mapping):
        lines.append(f"{head}{note}" if item else f"{head} {{}}{note}")
        for key, value in item.items():
            _dump_item(f"{pad}  {scalar_text(key)}:", value, depth + 1, comments, "", lines, inner)
    elif isinstance(item, list) and any(dataclasses.is_dataclass(part) for part in item):
        lines.append(f"{head}{note}")
        for part in item:
            _dump_item(f"{pad}-", part, depth, comments, "", lines, inner)
    else:
        lines.append(f"{head} {scalar_text(item)}{note}")
