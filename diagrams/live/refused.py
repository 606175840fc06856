"""What is wrong on the wire: it never ends the program, but is counted by kind, and the first of each is told."""

from __future__ import annotations

import sys
from collections.abc import Mapping

from diagrams.schema.errors import one_line

__all__ = ["Refusals", "Refused"]

_MOST = 50  # kinds of mistakes; there are not that many


class Refused(Exception):
    """A line, or a row, that is left out; `kind` is what it is counted by."""

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind


class Refusals:
    """How many lines were left out, by kind, and the first of each.

    Parameters
    ----------
    counts : mapping of str to int, optional
        To go on from.
    """

    def __init__(self, counts: Mapping[str, int] | None = None) -> None:
        self.counts = dict(counts or {})
        self.examples: dict[str, str] = {}

    def add(self, kind: str, message: str, count: int = 1) -> None:
        """Count; the first one is told at once."""
        if kind not in self.counts and len(self.counts) >= _MOST:
            kind = "others"
        self.counts[kind] = self.counts.get(kind, 0) + count
        if kind not in self.examples:
            self.examples[kind] = one_line(message)[:300]
            print(f"quietfix: live: left out: {self.examples[kind]}", file=sys.stderr, flush=True)

    @property
    def total(self) -> int:
        """How many there were."""
        return sum(self.counts.values())

    def summary(self) -> str:
        """Return a sentence; empty where nothing was left out."""
        if not self.counts:
            return ""
        kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(self.counts.items(), key=lambda one: -one[1]))
        return f"left out: {kinds}"
