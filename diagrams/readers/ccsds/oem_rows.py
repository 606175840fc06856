"""The rows of an ephemeris: epoch, position, velocity, and acceleration where there is one."""

from __future__ import annotations

from array import array
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.ccsds.kvn import KvnLine, KvnText, brief

__all__ = ["EphemerisRows"]

Array = NDArray[np.float64]

_NAMES = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT", "X_DDOT", "Y_DDOT", "Z_DDOT")
_UNITS = ("km", "km/s", "km/s**2")


class _Last(NamedTuple):
    """What is kept of a row until the next one."""

    words: list[str]
    epoch: tuple[int, float]
    line: int


class EphemerisRows:
    """Collects rows, each checked against the one before.

    Parameters
    ----------
    text : KvnText
        What they are read from.
    scale : str
        Of their epochs.
    """

    def __init__(self, text: KvnText, scale: str) -> None:
        self._text, self._scale = text, scale
        self._second, self._rest, self._values = array("q"), array("d"), array("d")
        self._last: _Last | None = None
        self._first_line = 0
        self._decimals: int | None = None  # fewest of the last number in the rows but the last one

    def add(self, line: KvnLine) -> None:
        """Add a row.

        Raises
        ------
        UserError
            For anything else, and for an epoch that does not come after the one before.
        """
        words = line.text.split()
        if line.assigned or len(words) not in (7, 10):
            self._text.refuse(
                line.number, f"{brief(line.text)} is not allowed; an epoch and 6 numbers, or 9 with an acceleration"
            )
        epoch = self._text.epoch(line.number, "epoch", words[0], self._scale)
        numbers = [
            self._text.number(line.number, name, word, _UNITS[i // 3])
            for i, (name, word) in enumerate(zip(_NAMES, words[1:], strict=False))
        ]
        if self._last is not None:
            if words == self._last.words:
                return
            if epoch <= self._last.epoch:
                self._text.refuse(
                    line.number, f"epoch {brief(words[0])} is not allowed; after that of line {self._last.line}"
                )
            decimals = _decimals(self._last.words[-1])
            self._decimals = decimals if self._decimals is None else min(decimals, self._decimals)
        else:
            self._first_line = line.number
        self._last = _Last(words, epoch, line.number)
        self._second.append(epoch[0])
        self._rest.append(epoch[1])
        self._values.extend([*numbers, *[np.nan] * (9 - len(numbers))])

    def check_end(self) -> None:
        """Refuse a last row of a file that may be cut: without a line end and with a shorter number."""
        if self._last is None or self._text.terminated:
            return
        if self._decimals is None or _decimals(self._last.words[-1]) < self._decimals:
            self._text.refuse(
                self._last.line, "the last line has no end and its last number is short; is the file cut?"
            )

    def epoch(self, row: int) -> tuple[int, tuple[int, float]]:
        """Return line and epoch of the first row (0) or the last one (-1)."""
        assert self._last is not None
        line = self._last.line if row else self._first_line
        return line, (self._second[row], self._rest[row])

    def shortest_step(self) -> float:
        """Return the shortest time between two rows [s]; 0 if there is only one."""
        if len(self._second) < 2:
            return 0.0
        return float(np.min(np.diff(np.array(self._second)) + np.diff(np.array(self._rest))))

    def columns(self, begin: int) -> tuple[NDArray[np.int64], Array, Array, Array]:
        """Return seconds and rests of the epochs (k,), states (k, 6) and accelerations (k, 3)."""
        if not self._second:
            self._text.refuse(begin, "a segment without a row of its ephemeris is not allowed")
        values = np.array(self._values).reshape(-1, 9)
        return np.array(self._second, dtype=np.int64), np.array(self._rest), values[:, :6].copy(), values[:, 6:].copy()


def _decimals(word: str) -> int:
    return len(word.partition(".")[2])
