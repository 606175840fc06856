"""The JSON Schema of a scenario, for editors that complete and check YAML."""

from __future__ import annotations

import dataclasses
import json
import typing
from collections.abc import Mapping
from typing import Any

from quietfix.diagrams.assembly.find import find
from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.schema.reading import Field, fields_of, options_of

__all__ = ["json_schema", "schema_text"]

_TYPES = {bool: "boolean", int: "integer", float: "number", str: "string"}


def json_schema(scenario: type, title: str) -> dict[str, Any]:
    """Return the schema (JSON Schema, draft 2020-12) of the file of a scenario.

    Types, limits, defaults and the meaning of every field are in it. JSON knows no YAML tags: where one chooses, a
    mapping may be that of any of them, the tag being its title; loading it sees whether it is that of its tag.

    Parameters
    ----------
    scenario : type
        Its dataclass.
    title : str
        Of the schema.
    """
    found = _Definitions()
    body = found.of_class(scenario)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **body,
        "title": title,
        "$defs": found.definitions,
    }


def schema_text(reference: str | None) -> str:
    """Return the schema as text, of a system that `find` finds or, by a YAML file or by None, of a user's own.

    Raises
    ------
    UserError
        If there is no such system.
    """
    if reference is None or reference.endswith((".yaml", ".yml")):
        found = json_schema(OwnScenario, "a system of one's own")
    else:
        system = find(reference).system
        found = json_schema(system.scenario, system.name)
    return json.dumps(found, indent=2)


class _Definitions:
    """Dataclasses met on the way, each written once."""

    def __init__(self) -> None:
        self.definitions: dict[str, Any] = {}
        self._names: dict[type, str] = {}

    def of_class(self, kind: type) -> dict[str, Any]:
        """Return the schema of a dataclass."""
        fields = fields_of(kind)
        doc = " ".join((kind.__doc__ or "").split("\n\n")[0].split())
        found = {
            "type": "object",
            "description": doc,
            "properties": {key: self._of_field(field) for key, field in fields.items()},
            "required": [key for key, field in fields.items() if field.required],
            "additionalProperties": False,
        }
        return {keyword: value for keyword, value in found.items() if value != []}

    def _reference(self, kind: type) -> dict[str, Any]:
        if kind not in self._names:
            taken = set(self._names.values())
            name = kind.__name__ if kind.__name__ not in taken else f"{kind.__name__}_{kind.__module__}"
            self._names[kind] = name
            self.definitions[name] = {}  # its place, before those that it leads to
            self.definitions[name] = {"title": f"!{kind.__name__}", **self.of_class(kind)}
        return {"$ref": f"#/$defs/{self._names[kind]}"}

    def _of_field(self, field: Field) -> dict[str, Any]:
        schema = self._of_type(field.type, {} if field.allowed is None else field.allowed.limits)
        schema = {"description": field.doc, **schema}
        if isinstance(field.default, bool | int | float | str | None):
            schema["default"] = field.default
        return schema

    def _of_type(self, kind: Any, limits: Mapping[str, Any]) -> dict[str, Any]:
        """Return the schema of an annotation; the limits are those of the numbers and texts in it."""
        origin, arguments, options = typing.get_origin(kind), typing.get_args(kind), options_of(kind)
        if len(options) > 1:
            return {"anyOf": [self._of_type(option, limits) for option in options]}
        if kind is type(None):
            return {"type": "null"}
        if dataclasses.is_dataclass(kind):
            return self._reference(typing.cast(type, kind))
        if origin is list:
            return {"type": "array", "items": self._of_type(arguments[0], limits)}
        if origin is dict:
            return {"type": "object", "additionalProperties": self._of_type(arguments[1], limits)}
        return {"type": _TYPES[kind], **limits} if kind in _TYPES else {}
