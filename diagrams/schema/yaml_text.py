"""YAML of bounded size: what a short text may ask of the memory is measured before it is loaded.

An alias costs a few letters and stands for whatever its anchor holds, so that a kilobyte can mean 10^9 values; nesting
costs a level of recursion in everything that walks the data. Both are counted in the parser's events, which are as
many as the text is long.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import yaml

__all__ = ["LONGEST", "TAG", "BadYaml", "lines_of", "load_yaml", "scalar_text"]

TAG = "_tag"
"""Under which name a mapping holds its YAML tag."""

LONGEST = 250_000
"""Of a text, in characters; the packaged scenarios have 4 kB at most."""

_DEEPEST = 30  # levels; a scenario needs 6
_MOST_VALUES = 50_000  # aliases written out

# Tags of mappings are kept; dates, which YAML reads without being asked to, stay texts (ISO 8601).
_Loader: Any = type("_Loader", (getattr(yaml, "CSafeLoader", yaml.SafeLoader),), {})
_Loader.add_multi_constructor("", lambda own, tag, node: {**own.construct_mapping(node, deep=True), TAG: tag})
_Loader.add_constructor("tag:yaml.org,2002:timestamp", lambda own, node: own.construct_yaml_timestamp(node).isoformat())


class BadYaml(ValueError):
    """A text that cannot be read; the message says what it is, to be put behind its name.

    Attributes
    ----------
    line : int or None
        Where, counted from 1, if that is known.
    """

    def __init__(self, message: str, line: int | None = None) -> None:
        super().__init__(message)
        self.line = line


def load_yaml(text: str) -> Any:
    """Return what a YAML text holds, tags of mappings kept under `TAG`.

    Raises
    ------
    BadYaml
        If it is not valid YAML, too long, too deep, its aliases stand for too much, or a mapping has a name twice.
    """
    if len(text) > LONGEST:
        raise BadYaml(f"is too long ({len(text)} characters; at most {LONGEST} are allowed)")
    try:
        excess = _excess(text)
        if excess is not None:
            raise BadYaml(excess)
        loader = _Loader(text)
        node = loader.get_single_node()
        _refuse_unclear(node)
        data = None if node is None else loader.construct_document(node)
    except BadYaml:
        raise
    except Exception as error:  # PyYAML's own, and what its constructors of dates and numbers let through
        raise _not_valid(text, error) from error
    if isinstance(data, dict):  # a place for anchors
        return {key: value for key, value in data.items() if not str(key).startswith("_")}
    return data


def _not_valid(text: str, error: Exception) -> BadYaml:
    mark = getattr(error, "problem_mark", None)
    words = str(getattr(error, "problem", None) or error)
    if words.startswith("but "):  # the second half of what PyYAML says
        words = f"{getattr(error, 'context', None) or ''}, {words}"
    reason = " ".join(words.split()) or type(error).__name__
    if mark is None:
        return BadYaml(f"is not valid YAML ({reason})")
    rows = text.splitlines()
    if mark.line < len(rows) and "\t" in rows[mark.line][: mark.column + 1]:
        reason += "; a tab, where there must be spaces"
    return BadYaml(f"is not valid YAML ({reason})", min(mark.line + 1, max(len(rows), 1)))  # the end is no line


def lines_of(text: str) -> dict[str, int]:
    """Return in which line each field of a YAML text is, counted from 1, by its dotted path.

    Parameters
    ----------
    text : str
        Of what `load_yaml` can read; of another one nothing is known.
    """
    try:
        root = yaml.compose(text, Loader=_Loader) if _excess(text) is None else None
    except yaml.YAMLError:
        return {}
    return {path: key.start_mark.line + 1 for path, key in _fields(root, "")}


def _fields(node: Any, path: str) -> Iterator[tuple[str, Any]]:
    """Yield dotted paths, and the node of the key (of an item in a list: the item) of each."""
    if isinstance(node, yaml.MappingNode):
        pairs = [(str(key.value), key, value) for key, value in node.value]
    elif isinstance(node, yaml.SequenceNode):
        pairs = [(str(i), item, item) for i, item in enumerate(node.value)]
    else:
        return
    for name, key, value in pairs:
        here = f"{path}.{name}" if path else name
        yield here, key
        yield from _fields(value, here)


def _refuse_unclear(node: Any, path: str = "") -> None:
    """Refuse a mapping that has a name twice, which YAML's readers pass over in silence, and a tag of no mapping."""
    if node is not None and node.tag.startswith("!") and not isinstance(node, yaml.MappingNode):
        line, head = node.start_mark.line + 1, f"{path}: " if path else ""
        raise BadYaml(f"is not allowed ({head}a mapping must follow {node.tag}, such as {node.tag} {{}})", line)
    if node is not None and node.tag.endswith(":timestamp"):
        try:
            yaml.safe_load(node.value)
        except ValueError as error:
            head = f"{path}: " if path else ""
            raise BadYaml(f"is not valid YAML ({head}{node.value}: {error})", node.start_mark.line + 1) from error
    pairs = node.value if isinstance(node, yaml.MappingNode) else []
    first: dict[tuple[str, str], int] = {}
    for key, _ in pairs:
        if not isinstance(key, yaml.ScalarNode) or key.value == "<<":
            continue
        line, where = key.start_mark.line + 1, f"{path}.{key.value}" if path else key.value
        if (key.tag, key.value) in first:
            before = first[key.tag, key.value]
            raise BadYaml(f"has {where} twice, the first time in line {before}; names must differ", line)
        first[key.tag, key.value] = line
    values = [(str(getattr(key, "value", "")), value) for key, value in pairs]
    if isinstance(node, yaml.SequenceNode):
        values = [(str(i), item) for i, item in enumerate(node.value)]
    for name, value in values:
        _refuse_unclear(value, f"{path}.{name}" if path else name)


def _excess(text: str) -> str | None:
    """Return how the text is too deep or stands for too much, None where it is not."""
    sizes: dict[str, int] = {}
    open_: list[tuple[str | None, int]] = []
    total = 0
    for event in yaml.parse(text, Loader=_Loader):
        anchor = getattr(event, "anchor", None)
        if isinstance(event, yaml.AliasEvent):
            if any(anchor == name for name, _ in open_):
                return f"has no end (the alias *{anchor} stands within what it stands for)"
            total += sizes.get(str(anchor), 0)
        elif isinstance(event, yaml.ScalarEvent):
            total += 1
            if anchor is not None:
                sizes[anchor] = 1
        elif isinstance(event, yaml.CollectionStartEvent):
            open_.append((anchor, total))
            total += 1
            if len(open_) > _DEEPEST:
                return f"is too deep (line {event.start_mark.line + 1}: at most {_DEEPEST} levels are allowed)"
        elif isinstance(event, yaml.CollectionEndEvent):
            name, before = open_.pop()
            if name is not None:
                sizes[name] = total - before
        if total > _MOST_VALUES:
            return f"is too large (at most {_MOST_VALUES} values are allowed, aliases written out)"
    return None


def scalar_text(item: Any) -> str:
    """Return one value, or a list of such, as YAML writes it."""
    if item is None:
        return "null"
    if isinstance(item, bool):
        return "true" if item else "false"
    if isinstance(item, float):
        # YAML 1.1 needs a dot in 1.0e-10.
        shown = repr(item)
        return shown if "." in shown or "e" not in shown else shown.replace("e", ".0e")
    if isinstance(item, list):
        return "[" + ", ".join(scalar_text(part) for part in item) + "]"
    if isinstance(item, str):
        plain = item.replace("_", "").replace("-", "").isalnum() and item[:1].isalpha()
        if plain and item.lower() not in ("true", "false", "null", "yes", "no", "on", "off", "y", "n"):
            return item
        if item.isprintable():
            return "'" + item.replace("'", "''") + "'"
        safe = (c if c.isprintable() and c not in '"\\' else f"\\U{ord(c):08x}" for c in item)
        return '"' + "".join(safe) + '"'
    return str(item)
