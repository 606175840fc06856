"""Data of YAML into dataclasses: their annotations are the schema, checked and filled in one walk."""

from __future__ import annotations

import copy
import dataclasses
import difflib
import math
import typing
from collections.abc import Mapping
from functools import cache
from types import NoneType, UnionType
from typing import Any, NamedTuple

from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.diagrams.schema.yaml_text import TAG, scalar_text
from quietfix.systems.documented import Allowed, refusal

__all__ = ["Field", "check_annotations", "fields_of", "options_of", "read"]

_KEYWORDS = {"class_": "class"}  # fields whose natural name is a Python keyword
_WORDS: dict[Any, str] = {bool: "true or false", int: "a whole number", float: "a number", str: "text"}
_LEAVES = (*_WORDS, Any, object, NoneType)
_ALLOWED = "bool, int, float, str, list[...], dict[str, ...], a dataclass, or a union of these"


class Field(NamedTuple):
    """A field of a dataclass: its attribute, its type, its default and what `documented` says of it."""

    name: str
    type: Any
    doc: str
    allowed: Allowed | None
    default: Any
    factory: Any

    @property
    def required(self) -> bool:
        """Whether it has no default."""
        return self.default is self.factory is dataclasses.MISSING


def fields_of(schema: Any) -> dict[str, Field]:
    """Return the fields of a dataclass by the names that a user writes.

    Raises
    ------
    ValueError
        If an annotation that is a text, as ``from __future__ import annotations`` makes it, is no type.
    """
    return _fields_of(schema)


@cache
def _fields_of(schema: Any) -> dict[str, Field]:
    fields = [one for one in dataclasses.fields(schema) if one.init]
    hints = {one.name: one.type for one in fields}
    if any(isinstance(hint, str) for hint in hints.values()):
        try:
            hints = typing.get_type_hints(schema)
        except Exception as error:
            raise ValueError(f"scenario: annotations of {schema.__qualname__}: {error}") from error
    said = [(one.metadata.get("doc", ""), one.metadata.get("allowed")) for one in fields]
    return {
        _KEYWORDS.get(one.name, one.name): Field(one.name, hints[one.name], *words, one.default, one.default_factory)
        for one, words in zip(fields, said, strict=True)
    }


def options_of(schema: Any) -> tuple[Any, ...]:
    """Return the types that a union is of; of another type, it alone."""
    return typing.get_args(schema) if typing.get_origin(schema) in (typing.Union, UnionType) else (schema,)


def check_annotations(schema: Any, where: str = "scenario", seen: set[Any] | None = None) -> None:
    """Check that YAML can fill a type, and all in it.

    Raises
    ------
    ValueError
        For an annotation that is none, or a type that no YAML fills.
    """
    seen = set() if seen is None else seen
    if isinstance(schema, type) and dataclasses.is_dataclass(schema):
        if schema not in seen:
            seen.add(schema)
            for field in fields_of(schema).values():
                check_annotations(field.type, f"{schema.__qualname__}.{field.name}", seen)
    elif options_of(schema) != (schema,) or typing.get_origin(schema) in (list, dict):
        for inner in typing.get_args(schema):
            check_annotations(inner, where, seen)
    elif not any(schema is leaf for leaf in _LEAVES):
        raise ValueError(f"{where}: the type {getattr(schema, '__name__', schema)} is not allowed; {_ALLOWED}")


def read(schema: Any, data: Any, path: str = "", default: Any = None) -> Any:
    """Return the value of a type that data mean.

    Parameters
    ----------
    schema : type
        Dataclass or type annotation.
    data : Any
        What YAML gave, tags of mappings under `TAG`.
    path : str
        Dotted path so far, for messages.
    default : Any
        What a mapping does not say stays as in this dataclass; lists and mappings of names are replaced.

    Raises
    ------
    UserError
        Naming the field, the value and what is allowed.
    """
    options = options_of(schema)
    if data is None and NoneType in options:
        return None
    if len(options) > 1:
        schema, data = _option([one for one in options if one is not NoneType], data, path), _untagged(data)
        default = default if type(default) is schema else None
    if dataclasses.is_dataclass(schema):
        return _read_fields(schema, data, path, default)
    inner = typing.get_args(schema)
    if typing.get_origin(schema) is list:
        if not isinstance(data, list):
            raise UserError(f"{path}: {data!r} is not allowed; a list")
        return [read(inner[0], item, f"{path}.{i}") for i, item in enumerate(data)]
    if typing.get_origin(schema) is dict:
        if not isinstance(data, Mapping):
            raise UserError(f"{path}: {data!r} is not allowed; a mapping")
        _refuse_untagged(inner[1], data, path)
        return {_name(key, path): read(inner[1], item, f"{path}.{key}") for key, item in data.items()}
    return _read_scalar(schema, data, path)


def _option(options: list[Any], data: Any, path: str) -> Any:
    """Return which option of a union the data means: by tag, by type, else the first."""
    if not isinstance(data, Mapping):
        return next((one for one in options if one in _WORDS and type(data) is one), options[0])
    tags = {getattr(one, "__name__", ""): one for one in options}
    tag = data.get(TAG, f"!{next(iter(tags))}")
    if not isinstance(tag, str):
        raise UserError(f"{path}.{TAG}: {tag!r} is not allowed; a tag such as !{next(iter(tags))}")
    return tags[choose(path, "!" + tag.lstrip("!"), ["!" + name for name in tags])[1:]]


def _refuse_untagged(schema: Any, data: Mapping[Any, Any], path: str) -> None:
    """Refuse what of a mapping of names could be of several kinds, and does not say which: a setting's typing error."""
    kinds = [one.__name__ for one in options_of(schema) if isinstance(one, type) and dataclasses.is_dataclass(one)]
    bare = [key for key, item in data.items() if isinstance(item, Mapping) and TAG not in item]
    if len(kinds) < 2 or not bare:
        return
    key, known = str(bare[0]), [str(one) for one in data if one not in bare]
    near = difflib.get_close_matches(key, known, 1)
    meant = f" (did you mean {near[0]}?)" if near else ""
    raise UserError(
        f"{path}.{key}: it has no tag{meant}; one is needed where it is new, such as {key}: !{kinds[0]} {{}}, of "
        f"{', '.join('!' + kind for kind in kinds)}"
    )


def _untagged(data: Any) -> Any:
    return {key: value for key, value in data.items() if key != TAG} if isinstance(data, Mapping) else data


def _read_fields(schema: Any, data: Any, path: str, default: Any) -> Any:
    if isinstance(data, Mapping) and data.get(TAG) == f"!{schema.__name__}":
        data = _untagged(data)
    if not isinstance(data, Mapping):
        raise UserError(f"{path or 'scenario'}: {data!r} is not allowed; a mapping of fields")
    fields, given, dot = fields_of(schema), {}, f"{path}." * bool(path)
    for key, item in data.items():
        here = f"{dot}{key}"
        field = fields[key if key in fields else choose(here, str(key), fields)]
        unsaid = None
        if isinstance(item, Mapping):
            usual = field.default if field.factory is dataclasses.MISSING else field.factory()
            unsaid = usual if default is None else getattr(default, field.name)
        given[field.name] = read(field.type, item, here, unsaid)
        _refuse(field, given[field.name], item, here)
    missing = [key for key, field in fields.items() if field.required and field.name not in given]
    if missing and default is None:
        raise UserError(f"{dot}{missing[0]}: it is missing, and has no default")
    try:
        return schema(**given) if default is None else dataclasses.replace(default, **given)
    except UserError:
        raise
    except Exception as error:  # of a user's own class; never show a traceback for a user's file
        raise UserError(f"{path or 'scenario'}: {' '.join(str(error).split())}") from error


def _refuse(field: Field, value: Any, data: Any, path: str) -> None:
    """Check a value against what its field allows; those of a list each."""
    if isinstance(value, list):
        for i, item in enumerate(value):
            _refuse(field, item, data[i], f"{path}.{i}")
    elif value is not None and (words := refusal(value, field.name, field.allowed)) is not None:
        raise UserError(f"{path}: {data!r} is not allowed; {words}")


def _name(key: Any, path: str) -> str:
    if not isinstance(key, str) or not key:
        given = scalar_text(key) if key != "" else "''"
        raise UserError(f"{path}: the name {given} is not allowed; text (a number in quotes)")
    if key == TAG or key in _KEYWORDS or key in _KEYWORDS.values():
        raise UserError(f"{path}: the name {key} is not allowed; another one, for that is a word of Python")
    return key


def _read_scalar(schema: Any, data: Any, path: str) -> Any:
    if schema not in _WORDS:
        return copy.deepcopy(data)
    number = isinstance(data, int | float) and not isinstance(data, bool)
    if schema is float and (number or isinstance(data, str)):  # YAML 1.1 reads 1e-3 as text
        try:
            return float(data)
        except OverflowError:
            return math.inf if data > 0 else -math.inf
        except ValueError:
            pass
    elif isinstance(data, schema) and (number or schema is not int):
        return schema(data)
    raise UserError(f"{path}: {data!r} is not allowed; {_WORDS[schema]}")
