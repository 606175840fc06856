"""Docstrings as parts of a page, and tables in reStructuredText."""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterable, Sequence
from typing import Any

from numpydoc.docscrape import NumpyDocString

__all__ = ["defaults_of", "described", "has_equation", "heading", "literal", "parameters", "plain", "table", "texts_of"]

_QUOTED = re.compile(r"(``.+?``|:\w+:`[^`]+`|`[^`]+`__?)|`([^`]+)`", re.DOTALL)
_FORMULA = re.compile(r"^\.\. math::(?P<formula>(?: [^\n]*)?(?:\n[ ]+[^\n]+)+|[^\n]+)\n?", re.MULTILINE)
_SHORT = 75  # characters of LaTeX that stay on one line
_SECTION = re.compile(r"\n(?:Parameters|Attributes|Returns|Raises|Notes|References|Examples|See Also)\n-+\n")


def literal(text: str) -> str:
    """Return a text in which names in single backticks are code, and nothing is looked up."""
    return _QUOTED.sub(lambda found: found[1] or f"``{found[2]}``", text)


def plain(text: str) -> str:
    """Return a text that is no reStructuredText as it: only names in backticks mean something."""
    parts = re.split(r"(`+[^`]+`+)", text)
    return "".join(part if part.startswith("`") else re.sub(r"([|*\\]|_(?=\W|$))", r"\\\1", part) for part in parts)


def heading(text: str, line: str) -> str:
    """Return a heading."""
    return f"{text}\n{line * len(text)}\n"


def table(head: Sequence[str], rows: Iterable[Sequence[str]], widths: Sequence[int] | None = None) -> str:
    """Return a table of texts."""
    wide = f"   :widths: {' '.join(map(str, widths))}\n" if widths else ""
    lines = [f".. list-table::\n   :header-rows: 1\n   :class: catalogue\n{wide}"]
    for row in (head, *rows):
        for i, cell in enumerate(row):
            mark = "   * -" if i == 0 else "     -"
            first, *more = (cell or "").split("\n")
            lines.append(f"{mark} {first}".rstrip())
            lines += [f"       {line}".rstrip() for line in more]
    return "\n".join(lines) + "\n"


def _parts(doc: str) -> tuple[str, NumpyDocString]:
    clean = inspect.cleandoc(doc)
    body = _SECTION.split("\n" + clean + "\n", maxsplit=1)[0].strip()
    parsed = NumpyDocString(clean)
    return body, parsed


def _on_lines(block: re.Match[str]) -> str:
    """Return a formula of several parts with each on a line of its own, where they are too long for one."""
    parts = [" ".join(part.split()).removesuffix(",") for part in block["formula"].split(r"\qquad")]
    if len(parts) == 1 or len(block["formula"]) < _SHORT:
        return block[0]
    return ".. math::\n\n" + "\n\n".join(f"   {part}" for part in parts) + "\n"


def described(kind: Any) -> str:
    """Return what a class's docstring says before its sections, and its notes and references."""
    body, parsed = _parts(kind.__doc__ or "")
    notes = ["\n".join(parsed[section]).strip() for section in ("Notes", "References")]
    return _FORMULA.sub(_on_lines, "\n\n".join(literal(text) for text in (body, *notes) if text) + "\n")


def parameters(kind: Any) -> list[tuple[str, str, str]]:
    """Return names, types and meanings of the parameters that a class's docstring, or else its base's, tells of."""
    for one in kind.__mro__:
        if not (one.__doc__ and one.__module__.startswith("quietfix")):
            continue
        _, parsed = _parts(one.__doc__)
        if parsed["Parameters"]:
            return [(p.name, literal(p.type), literal("\n".join(p.desc))) for p in parsed["Parameters"]]
    return []


def defaults_of(kind: Any) -> dict[str, str]:
    """Return what parameters are when nothing is said, as code."""
    try:
        given = inspect.signature(kind.__init__).parameters.values()
    except (TypeError, ValueError):
        return {}
    return {one.name: _short(one.default) for one in given if one.default is not inspect.Parameter.empty}


def _short(value: Any) -> str:
    if inspect.isclass(value) or inspect.isfunction(value):
        return value.__name__
    text = " ".join(repr(value).split())
    return text if len(text) <= 40 and " at 0x" not in text else f"{type(value).__name__}(...)"


def texts_of(kind: type) -> list[str]:
    """Return all that the code says of a class: of itself, its bases and their modules."""
    found = []
    for one in kind.__mro__:
        if one.__module__.startswith("quietfix"):
            found += [one.__doc__ or "", sys.modules[one.__module__].__doc__ or ""]
    return found


def has_equation(text: str) -> bool:
    """Return whether a text has an equation."""
    return ":math:" in text or ".. math::" in text
