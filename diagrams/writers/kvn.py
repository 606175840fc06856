"""Lines in keyword = value notation."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Protocol

__all__ = ["assignments", "comments", "message_text"]

_ENDS = re.compile(r"\r\n|\r|\n")


class _Message(Protocol):
    """What the messages of CCSDS have in common."""

    @property
    def version(self) -> str: ...

    @property
    def comments(self) -> Sequence[str]: ...

    @property
    def header(self) -> Mapping[str, str]: ...

    @property
    def segments(self) -> Sequence[Any]: ...


def message_text(
    kind: str,
    message: _Message,
    header: Iterable[str],
    metadata: Iterable[str],
    data: Callable[[Any], Iterator[str]],
) -> str:
    """Return a message as text.

    Parameters
    ----------
    kind : str
        OEM, TDM ...
    message : EphemerisMessage, TrackingMessage ...
    header, metadata : iterable of str
        Keywords in the standard's order.
    data : callable
        Gets a segment, and yields the lines after its metadata.

    Raises
    ------
    ValueError
        As `assignments`, and what `data` raises.
    """
    lines = [f"CCSDS_{kind}_VERS = {message.version}"]
    lines += [*comments(message.comments), *assignments(message.header, header)]
    for segment in message.segments:
        lines += ["", "META_START", *comments(segment.comments), *assignments(segment.metadata, metadata), "META_STOP"]
        lines += data(segment)
    return "\n".join([*lines, ""])


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
