"""Lines in keyword = value notation."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping

__all__ = ["assignments", "comments"]

_ENDS = re.compile(r"\r\n|\r|\n")


def comments(texts: Iterable[str]) -> Iterator[str]:
    """Return lines of comment, one or more for each text."""
    for text in texts:
        yield from (f"COMMENT {line}".rstrip() for line in _ENDS.split(text))


def assignments(found: Mapping[str, str], order: Iterable[str]) -> Iterator[str]:
    """Return a line for each keyword that there is, in the standard's order.

    Raises
    ------
    ValueError
        If a value is empty or of more than one line, or a keyword is not the standard's.
    """
    names = list(order)
    for name in found:
        if name not in names:
            raise ValueError(f"{name!r} is not allowed; {', '.join(names)}")
    for name in names:
        if name in found:
            if _ENDS.search(found[name]) or not found[name].strip():
                raise ValueError(f"{name} {found[name]!r} is not allowed; one line of text")
            yield f"{name} = {found[name]}"
