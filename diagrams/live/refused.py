"""What is wrong or doubtful on the wire: it ends nothing, but is counted by kind, and the first of each is told."""

from __future__ import annotations

import sys

from quietfix.diagrams.schema.errors import one_line

__all__ = ["Counted", "Refused"]

_MOST = 50  # kinds of mistakes; there are not that many


class Refused(Exception):
    """A line, or a row, that is left out; `kind` is what it is counted by."""

    def __init__(self, kind: str, message: str) -> None:
        super().__init__(message)
        self.kind = kind


class Counted:
    """How many there were of each kind, and the first of each.

    Parameters
    ----------
    what : str
        What is said of all of them.
    """

    def __init__(self, what: str) -> None:
        self._what = what
        self.counts: dict[str, int] = {}
        self.examples: dict[str, str] = {}

    def add(self, kind: str, message: str, count: int = 1) -> None:
        """Count; the first one is told at once."""
        if kind not in self.counts and len(self.counts) >= _MOST:
            kind = "others"
        self.counts[kind] = self.counts.get(kind, 0) + count
        self.once(kind, message)

    def once(self, kind: str, message: str) -> None:
        """Tell the first of a kind, and count nothing."""
        if kind not in self.examples:
            self.examples[kind] = one_line(message)[:300]
            print(f"quietfix: live: {self._what}: {self.examples[kind]}", file=sys.stderr, flush=True)

    @property
    def total(self) -> int:
        """How many there were."""
        return sum(self.counts.values())

    def summary(self) -> str:
        """Return a sentence; empty where there were none."""
        if not self.counts:
            return ""
        kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(self.counts.items(), key=lambda one: -one[1]))
        return f"{self._what}: {kinds}"
