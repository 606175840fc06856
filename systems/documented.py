"""Dataclass fields that carry their meaning and what is allowed, for checks and for the printed scenario."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from quietfix.systems.constants import SPEED_OF_LIGHT

__all__ = ["Allowed", "choice", "count", "documented", "number", "refusal", "text"]

_LARGEST = {
    "s": 1e9,
    "ms": 1e9,
    "us": 1e12,
    "ns": 1e12,
    "m": 1e12,
    "km": 1e9,
    "m2": 1e6,
    "mps": SPEED_OF_LIGHT,
    "kmps": SPEED_OF_LIGHT / 1e3,
    "kmph": 1e9,
    "degps": 1e6,
    "mps2": 1e6,
    "m2ps2": 1e12,
    "m2ps3": 1e12,
    "m3ps2": 1e17,
    "radps": 1e3,
    "hz": 1e12,
    "mhz": 1e6,
    "mbd": 1e6,
    "ghz": 1e6,
    "deg": 1e6,
    "db": 300.0,
    "kgps": 1e6,
    "kn": 1e6,
    "t": 1e6,
}
"""Largest magnitudes by the unit that ends a field's name: far beyond what is built, flies or is measured on and near
the Earth (the gravitational parameter is Jupiter's), and small enough that squares and quotients stay finite."""

_LARGEST_OTHER = 1e12
_SMALLEST_DIVISOR = 1e-15  # it may be squared before
_LARGEST_COUNT = 1_000_000


@dataclass(frozen=True)
class Allowed:
    """What a field may be: a test, the same in words, whether a number is divided by (> 0), and as in JSON Schema."""

    test: Callable[[Any], bool]
    words: str
    divisor: bool = False
    limits: Mapping[str, Any] = field(default_factory=dict)


def refusal(value: Any, name: str, allowed: Allowed | None) -> str | None:
    """Return what a field may be, in words, where a value is not that; None where it is.

    Parameters
    ----------
    value : Any
        Of the field's type.
    name : str
        Of the field; what follows its last underscore is the unit of a number.
    allowed : Allowed, optional
        What the field itself says.
    """
    if allowed is not None and not allowed.test(value):
        return allowed.words
    if not isinstance(value, float):
        return None
    largest = _LARGEST.get(name.rpartition("_")[2], _LARGEST_OTHER)
    if not abs(value) <= largest:
        return f"a finite number, at most {largest:g} in size"
    if allowed is not None and allowed.divisor and value < _SMALLEST_DIVISOR:
        return f"{allowed.words}, at least {_SMALLEST_DIVISOR:g}"
    return None


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

    limits = {"exclusiveMinimum": above, "minimum": at_least, "maximum": at_most}
    given = {keyword: limit for keyword, limit in limits.items() if limit is not None}
    return documented(doc, default, allowed=Allowed(test, words, divisor=above == 0, limits=given))


def count(doc: str, default: int, *, at_least: int = 1, at_most: int = _LARGEST_COUNT) -> Any:
    """Return a field for a whole number, with limits."""
    words = f"a whole number >= {at_least} and <= {at_most}"
    limits = {"minimum": at_least, "maximum": at_most}
    return documented(doc, default, allowed=Allowed(lambda v: at_least <= v <= at_most, words, limits=limits))


def choice(doc: str, default: str, options: tuple[str, ...]) -> Any:
    """Return a field for one of a few words."""
    words, limits = "one of " + ", ".join(options), {"enum": list(options)}
    return documented(doc, default, allowed=Allowed(lambda v: v in options, words, limits=limits))


def text(doc: str, default: str = "") -> Any:
    """Return a field for any text."""
    return documented(doc, default)
