"""What may stand in a YAML file: every dataclass that a scenario or a file of requirements is read into."""

from __future__ import annotations

import dataclasses
import re
import typing
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from quietfix.diagrams.assembly.find import find, systems
from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.own.fields.sensors import KINDS
from quietfix.diagrams.schema.reading import Field, fields_of, options_of
from quietfix.diagrams.verification.specification import Specification, read_specification

__all__ = ["Example", "Tag", "default_words", "examples", "examples_of", "tags", "type_words"]

ROOT = Path(__file__).resolve().parents[3]
_EXAMPLES = "docs/catalogue/examples"
_FOLDERS = (
    *(f"{_EXAMPLES}{inner}" for inner in ("", "/packaged", "/requirements")),
    *("tests/own", "diagrams/library/scenarios", "tests/requirements"),
)
_WORDS = {bool: "true or false", int: "whole number", float: "number", str: "text", type(None): "null"}


class Tag(NamedTuple):
    """A dataclass that YAML fills: where it stands, and whether its tag must be written there."""

    kind: type
    where: tuple[str, ...]
    chosen: bool

    @property
    def name(self) -> str:
        """What is written, without the exclamation mark."""
        return self.kind.__name__


class Example(NamedTuple):
    """A part of a file: its lines, the file, and the keys on the way to it."""

    text: str
    file: str
    path: str


@cache
def tags() -> dict[type, Tag]:
    """Return all of them, those of a system of one's own first."""
    found: dict[type, tuple[list[str], bool]] = {}
    roots = {"": OwnScenario, **{f"{name}: ": find(name).system.scenario for name in systems()}}
    roots["requirements: "] = Specification
    for name, scenario in roots.items():
        _walk(scenario, name, found)
    for kind in KINDS:
        sensor = next(one for one in found if one is not kind and issubclass(one, kind))
        found[sensor][0].extend(found.pop(kind)[0])  # what a sensor may be, a part of a !Joint may be, with less fields
    return {kind: Tag(kind, tuple(dict.fromkeys(where)), chosen) for kind, (where, chosen) in found.items()}


def _walk(kind: type, path: str, found: dict[type, tuple[list[str], bool]]) -> None:
    for key, field in fields_of(kind).items():
        dot = "" if not path or path.endswith(": ") else "."
        _visit(field.type, f"{path}{dot}{key}", found, chosen=False)


def _visit(schema: Any, path: str, found: dict[type, tuple[list[str], bool]], chosen: bool) -> None:
    options = [one for one in options_of(schema) if one is not type(None)]
    if len(options) > 1:
        for one in options:
            _visit(one, path, found, chosen=True)
    elif dataclasses.is_dataclass(options[0]):
        kind = typing.cast(type, options[0])
        if kind in found:
            where, before = found[kind]
            if len(where) < 12:
                where.append(path)
            found[kind] = where, before or chosen
        else:
            found[kind] = [path], chosen
            _walk(kind, path, found)
    else:
        names = typing.get_args(options[0])
        inner = names[1:] if typing.get_origin(options[0]) is dict else names
        for one in inner:
            _visit(one, path + (".NAME" if typing.get_origin(options[0]) is dict else "[]"), found, chosen)


def type_words(schema: Any) -> str:
    """Return in words what a field takes."""
    options = options_of(schema)
    if len(options) > 1:
        words = [type_words(one) for one in options]
        return " or ".join(words) if len(words) <= 4 else f"{words[0]}, {words[1]} ... ({len(words)} kinds)"
    if dataclasses.is_dataclass(schema):
        return f"``!{typing.cast(type, schema).__name__}``"
    origin, inner = typing.get_origin(schema), typing.get_args(schema)
    if origin is list:
        return f"list of {type_words(inner[0])}"
    if origin is dict:
        return f"by name: {type_words(inner[1])}"
    return _WORDS.get(schema, "anything")


def default_words(field: Field) -> str:
    """Return what a field is where nothing is said."""
    if field.required:
        return "*needed*"
    if field.factory is not dataclasses.MISSING:
        made = field.factory()
        if dataclasses.is_dataclass(made):
            return f"``!{type(made).__name__} {{}}``"
        return f"``{made!r}``" if len(repr(made)) < 60 else "*see the scenario*"
    value = field.default
    if value is None:
        return "``null``"
    if isinstance(value, bool):
        return f"``{str(value).lower()}``"
    return "*empty*" if value == "" else f"``{value:.12g}``" if isinstance(value, float) else f"``{value}``"


@cache
def examples() -> dict[str, list[Example]]:
    """Return, for every tag, what files of the project have of it, those of the catalogue first."""
    found: dict[str, list[Example]] = {}
    for folder in _FOLDERS:
        for path in sorted((ROOT / folder).glob("*.yaml")):
            _load(path)
            text = path.read_text(encoding="utf-8")
            node = yaml.compose(text, Loader=yaml.SafeLoader)
            _collect(node, None, text, f"{folder}/{path.name}", "", found)
    return found


def _load(path: Path) -> None:
    """Load a file as the commands do; what is wrong with it is an error of the site."""
    name, _, rest = path.name.partition(".")
    if rest.endswith("requirements.yaml"):
        read_specification(path)
    elif path.parent.name == "packaged":
        find(name).system.load(None, path)
    elif path.parent.name == "scenarios":
        find(name).system.load(rest.removesuffix("yaml").removesuffix(".") or None)
    else:
        find(str(path)).system.load()


def examples_of(tag: Tag) -> list[Example]:
    """Return the examples of a tag that stand where it may, those of the catalogue first and then the shortest."""
    places = [re.escape(where.rpartition(": ")[2]) for where in tag.where]
    allowed = re.compile("|".join(place.replace("NAME", "[^.]+") for place in places))
    shown = [one for one in examples().get(tag.name, []) if allowed.fullmatch(one.path)]
    return sorted(shown, key=lambda one: (not one.file.startswith(_EXAMPLES), len(one.text)))


def _collect(node: Any, key: Any, text: str, file: str, path: str, found: dict[str, list[Example]]) -> None:
    if isinstance(node, yaml.MappingNode):
        if node.tag.startswith("!"):
            found.setdefault(node.tag[1:], []).append(Example(_cut(node, key, text), file, path))
        for name, value in node.value:
            _collect(value, name, text, file, f"{path}.{name.value}" if path else name.value, found)
    elif isinstance(node, yaml.SequenceNode):
        for value in node.value:
            _collect(value, None, text, file, f"{path}[]", found)


def _cut(node: Any, key: Any, text: str) -> str:
    """Return the lines of a node with its key, moved to the left margin and without what stands before or after it."""
    begin = (key or node).start_mark
    end = node.end_mark
    lines = text[begin.index : end.index].rstrip().split("\n")
    return "\n".join(
        [
            lines[0],
            *(
                line[begin.column :] if line[: begin.column].isspace() or not line.strip() else line
                for line in lines[1:]
            ),
        ]
    ).rstrip()
