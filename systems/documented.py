"""Dataclass fields that carry their meaning and what is allowed, for checks and for the printed scenario."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

__all__ = ["Allowed", "choice", "count", "documented", "number", "text"]


@dataclass(frozen=True)
class Allowed:
    """What a field may be: a test, and the same in words."""

    test: Callable[[Any], bool]
    words: str


def documented(
    doc: str, default: Any = None, factory: Callable[[], Any] | None = None, allowed: Allowed | None = None
) -> Any:
    """Return a dataclass field with documentation and, if given, a check."""
    metadata = {"doc": doc, "allowed": allowed}
    if factory is not None:
        return field(default_factory=factory, metadata=metadata)
    return field(default=default, metadata=metadata)


def number(
    doc: str,
    default: float | None,
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
) -> Any:
    """Return a field for a finite number, with limits; the unit is in the field's name."""
    words = "a finite number"
    if above is not None:
        words += f" > {above:g}"
    if at_least is not None:
        words += f" >= {at_least:g}"
    if at_most is not None:
        words += f"{' and' if above is not None or at_least is not None else ''} <= {at_most:g}"

    def test(value: float) -> bool:
        return (
            math.isfinite(value)
            and (above is None or value > above)
            and (at_least is None or value >= at_least)
            and (at_most is None or value <= at_most)
        )

    return documented(doc, default, allowed=Allowed(test, words))


def count(doc: str, default: int, *, at_least: int = 1, at_most: int | None = None) -> Any:
    """Return a field for a whole number, with limits."""
    words = f"a whole number >= {at_least}" + ("" if at_most is None else f" and <= {at_most}")
    return documented(
        doc, default, allowed=Allowed(lambda v: v >= at_least and (at_most is None or v <= at_most), words)
    )


def choice(doc: str, default: str, options: tuple[str, ...]) -> Any:
    """Return a field for one of a few words."""
    return documented(doc, default, allowed=Allowed(lambda v: v in options, "one of " + ", ".join(options)))


def text(doc: str, default: str = "") -> Any:
    """Return a field for any text."""
    return documented(doc, default)
