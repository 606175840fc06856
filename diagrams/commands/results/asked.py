"""What two results were asked for differently, in the words of their files."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from quietfix.diagrams.schema.scenario import read_yaml

__all__ = ["asked_lines"]

_NONE = object()
_LONGEST = 200  # characters of a value
_MOST = 20  # lines
_FILES = "system_files"
_CONTENT = "system_fingerprint"
_PATH = "system_file"


def asked_lines(was: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return a line for each field in which two results differ, A and B.

    Parameters
    ----------
    was, now : dict
        Their attributes; of a scenario, which is YAML, field by field. A field that only one of them has is told
        without the parts that are zero or nothing. Digests of files are told as files that differ.
    """
    found: list[str] = []
    for key in [*was, *(key for key in now if key not in was)]:
        a, b = was.get(key, _NONE), now.get(key, _NONE)
        if a == b or key in (_CONTENT, _PATH, _FILES):
            continue
        if key == "scenario" and isinstance(a, str) and isinstance(b, str):
            found += [_line(*one) for one in _fields("", read_yaml(a), read_yaml(b))]
        else:
            found.append(_line(key, a, b))
    if was.get("system") == now.get("system"):  # of two systems the files are two
        found += _files(was, now)
    found = list(dict.fromkeys(found))  # some fields of a scenario are attributes, too
    more = len(found) - _MOST
    return found if more <= 0 else [*found[:_MOST], f"{more} fields more, which --json has"]


def _fields(path: str, was: Any, now: Any) -> Iterator[tuple[str, Any, Any]]:
    """Yield the fields that differ, by dotted keys; those of another kind as a whole."""
    if isinstance(was, Mapping) and isinstance(now, Mapping) and was.get("_tag") == now.get("_tag"):
        for key in [*was, *(key for key in now if key not in was)]:
            yield from _fields(f"{path}.{key}" if path else str(key), was.get(key, _NONE), now.get(key, _NONE))
    elif isinstance(was, list) and isinstance(now, list) and len(was) == len(now):
        for k, pair in enumerate(zip(was, now, strict=True)):
            yield from _fields(f"{path}.{k}", *pair)
    elif was is not now and was != now:
        yield path, was, now


def _line(key: str, a: Any, b: Any) -> str:
    if a is _NONE or b is _NONE:
        there, where = (b, "B") if a is _NONE else (a, "A")
        return f"{key}: only in {where}: {_shortened(_said(there))}"
    return f"{key}: {_shortened(_said(a))} in A, {_shortened(_said(b))} in B"


def _said(value: Any) -> str:
    """Return a value as a file has it, without what is zero or nothing within it."""
    if isinstance(value, Mapping):
        tag = str(value.get("_tag") or "")
        parts = ", ".join(f"{key}: {_said(part)}" for key, part in value.items() if key != "_tag" and _is(part))
        return f"{tag} {{{parts}}}".strip() if parts or not tag else tag
    if isinstance(value, list | tuple):
        return f"[{', '.join(_said(part) for part in value)}]"
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "null"}[value]
    if isinstance(value, float):
        return str(int(value)) if value.is_integer() and abs(value) < 1e9 else repr(value)
    return str(value) if str(value) else "''"


def _is(value: Any) -> bool:
    """Whether anything is told by a part of what only one result has."""
    if isinstance(value, Mapping):
        return bool(value.get("_tag")) or any(_is(part) for part in value.values())
    return value is not None and value is not False and value not in ("", [], 0)


def _shortened(text: str) -> str:
    return text if len(text) <= _LONGEST else text[: _LONGEST - 4].rstrip(" ,") + " ..."


def _files(was: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return which files of a system one's own are not the same; the scenario is told for itself."""
    mine, its = (_digests(one) for one in (was, now))
    lines = []
    for name in [*mine, *(name for name in its if name not in mine)]:
        if name not in its or name not in mine:
            lines.append(f"file {name}: only in {'A' if name in mine else 'B'}")
        elif mine[name] != its[name]:
            lines.append(f"file {name}: has changed between A and B")
    paths = [one.get(_PATH) for one in (was, now)]
    if was.get(_CONTENT) != now.get(_CONTENT):
        where = str(was.get("system")) if paths[0] == paths[1] else f"{paths[0]} in A, {paths[1]} in B"
        lines.append(f"file {where}: has changed between A and B")
    return lines


def _digests(attributes: Mapping[str, Any]) -> dict[str, Any]:
    found = attributes.get(_FILES)
    try:
        return dict(json.loads(found)) if isinstance(found, str) and found else {}
    except ValueError:
        return {}
