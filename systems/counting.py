"""How often something that costs time was done: blocks evaluated, equations solved, diagrams built."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

__all__ = ["counting", "tally"]

_open: list[Counter[str]] = []


class Named(Protocol):
    """A block."""

    def get_name(self) -> str:
        """Return its name."""


def tally(what: str, block: Named | None = None) -> None:
    """Note that something was done once, ``what``, or of a block ``NAME.what``; nothing unless someone is counting."""
    if _open:
        name = what if block is None else f"{block.get_name()}.{what}"
        for counter in _open:
            counter[name] += 1


@contextmanager
def counting() -> Iterator[Counter[str]]:
    """Count what is done within the ``with`` block.

    Yields
    ------
    collections.Counter
        How often, by what: ``NAME.reading`` of a sensor, ``NAME.prior`` and ``NAME.posterior`` of an estimator;
        ``solved`` equations of motion, ``read`` files; of diagrams ``declared``, ``wired`` and ``built``; ``bounded``
        recursions of the bound.
    """
    counter: Counter[str] = Counter()
    _open.append(counter)
    try:
        yield counter
    finally:
        _open[:] = [other for other in _open if other is not counter]
