"""Columns of dates with a time of day and a zone, as seconds of TAI."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.earth.time_scales import from_tai, to_tai

__all__ = ["BadStamp", "read_stamps", "write_stamps"]

_ZONES = ("Z", "z")


class BadStamp(ValueError):
    """A text that is no date; `at` says which of the column."""

    def __init__(self, at: int, message: str) -> None:
        super().__init__(message)
        self.at = at


def read_stamps(texts: Sequence[str]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return ISO 8601 dates with a zone as moments: whole seconds of TAI since 1970, and the rest, 0 to 1 [s].

    Differences of moments are times that have passed, leap seconds too; see `quietfix.systems.earth.time_scales`.

    Raises
    ------
    BadStamp
        For a text that is none, or has no zone.
    """
    whole, rest = np.empty(len(texts), dtype=np.int64), np.empty(len(texts))
    for i, text in enumerate(texts):
        try:
            whole[i], rest[i] = to_tai(text, "UTC", offsets=True)
        except ValueError as error:
            raise BadStamp(i, str(error)) from error
        if not (text.endswith(_ZONES) or "+" in text[-6:] or "-" in text[-6:]):
            raise BadStamp(i, f"{text[:60]!r} is not allowed without its zone; Z for UTC, or an offset such as +02:00")
    return whole, rest


def write_stamps(began: tuple[int, float], seconds: NDArray[np.float64]) -> list[str]:
    """Return dates, UTC to a nanosecond, of times after a beginning.

    Parameters
    ----------
    began : (int, float)
        Seconds of TAI since 1970, whole ones and the rest.
    seconds : ndarray, shape (rows,)
        After that, finite.
    """
    whole = np.floor(seconds)
    rest = np.round(began[1] + (seconds - whole), 9)
    carried = np.floor(rest)
    rest = np.round(rest - carried, 9)
    second = began[0] + (whole + carried).astype(np.int64)
    return [f"{from_tai(a, b)}Z" for a, b in zip(second.tolist(), rest.tolist(), strict=True)]
