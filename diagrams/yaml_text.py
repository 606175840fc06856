"""YAML of bounded size: what a short text may ask of the memory is measured before it is loaded.

An alias costs a few letters and stands for whatever its anchor holds, so that a kilobyte can mean 10^9 values; nesting
costs a level of recursion in everything that walks the data. Both are counted in the parser's events, which are as
many as the text is long.
"""

from __future__ import annotations

from typing import Any

import yaml
from pydrake.common.yaml import yaml_load

__all__ = ["LONGEST", "load_yaml"]

LONGEST = 250_000
"""Of a text, in characters; the packaged scenarios have 4 kB at most."""

_DEEPEST = 30  # levels; a scenario needs 6
_MOST_VALUES = 50_000  # aliases written out
_PARSER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def load_yaml(text: str) -> Any:
    """Return what a YAML text holds, tags of mappings kept as ``_tag``.

    Raises
    ------
    ValueError
        If it is not valid YAML, too long, too deep, or its aliases stand for too much; what the text is, to be put
        behind its name.
    """
    if len(text) > LONGEST:
        raise ValueError(f"is too long ({len(text)} characters; at most {LONGEST} are allowed)")
    try:
        excess = _excess(text)
        data = yaml_load(data=text) if text and excess is None else None
    except Exception as error:  # PyYAML's own, and what its constructors of dates and numbers let through
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ValueError(f"is not valid YAML ({reason})") from error
    if excess is not None:
        raise ValueError(excess)
    return data


def _excess(text: str) -> str | None:
    """Return how the text is too deep or stands for too much, None where it is not."""
    sizes: dict[str, int] = {}
    open_: list[tuple[str | None, int]] = []
    total = 0
    for event in yaml.parse(text, Loader=_PARSER):
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
