"""Covariance matrices of an ephemeris."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.ccsds.kvn import KvnLine, KvnText, brief

__all__ = ["Covariance", "read_covariances"]

Array = NDArray[np.float64]

_SIZE = 6


@dataclass(frozen=True, eq=False)
class Covariance:
    """The covariance of a state.

    Attributes
    ----------
    second, rest : int, float
        Epoch: whole seconds of TAI since 1970, and the rest [s].
    frame : str
        Axes that it is in; empty: those of the ephemeris. RTN, RSW and TNW are axes of the orbit.
    matrix : ndarray, shape (6, 6)
        Of position and velocity [km^2, km^2/s, km^2/s^2].
    """

    second: int
    rest: float
    frame: str
    matrix: Array

    def __eq__(self, other: object) -> bool:
        """Tell whether all of it is equal."""
        if not isinstance(other, Covariance):
            return NotImplemented
        same = (self.second, self.rest, self.frame) == (other.second, other.rest, other.frame)
        return same and np.array_equal(self.matrix, other.matrix)

    __hash__ = None  # type: ignore[assignment]


def read_covariances(
    text: KvnText, lines: Iterator[KvnLine], first: KvnLine, metadata: Mapping[str, str]
) -> tuple[Covariance, ...]:
    """Read what stands between COVARIANCE_START and COVARIANCE_STOP.

    Raises
    ------
    UserError
        For anything but epochs that increase, frames and lower triangles of 6 rows, for a negative variance, and for a
        file that ends in it.
    """
    found: list[Covariance] = []
    rows: list[list[float]] = []
    epoch: tuple[int, float] | None = None
    frame, at = "", first.number
    for line in lines:
        if line.keyword == "COMMENT":
            continue
        if line.keyword == "COVARIANCE_STOP" and not line.value:
            if epoch is not None or not found:
                text.refuse(line.number, f"COVARIANCE_STOP after {len(rows)} rows is not allowed; {_SIZE}")
            return tuple(found)
        if line.assigned and not rows:
            if text.keyword(line, ("EPOCH", "COV_REF_FRAME"), "in a covariance") == "EPOCH":
                epoch, frame, at = (
                    text.epoch(line.number, "EPOCH", line.value, metadata["TIME_SYSTEM"]),
                    "",
                    line.number,
                )
                if found and epoch <= (found[-1].second, found[-1].rest):
                    text.refuse(line.number, f"EPOCH {brief(line.value)} is not allowed; after the one before")
            else:
                frame = line.value.upper()
            continue
        if epoch is None:
            text.refuse(line.number, f"{brief(line.text)} is not allowed; EPOCH = before a covariance")
        rows.append(_row(text, line, len(rows)))
        if len(rows) == _SIZE:
            found.append(Covariance(*epoch, frame, _matrix(rows)))
            rows, epoch = [], None
    text.refuse(None, f"it ends before the COVARIANCE_STOP of line {at}'s covariance")


def _row(text: KvnText, line: KvnLine, number: int) -> list[float]:
    words = line.text.split()
    if line.assigned or len(words) != number + 1:
        text.refuse(
            line.number, f"{brief(line.text)} is not allowed; row {number + 1} of a covariance: its lower triangle"
        )
    values = [text.number(line.number, "covariance", word) for word in words]
    if values[-1] < 0:
        text.refuse(line.number, f"variance {brief(words[-1])} is not allowed; a number >= 0")
    return values


def _matrix(rows: list[list[float]]) -> Array:
    lower = np.zeros((_SIZE, _SIZE))
    for i, row in enumerate(rows):
        lower[i, : i + 1] = row
    return lower + np.tril(lower, -1).T
