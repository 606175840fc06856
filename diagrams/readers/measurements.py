"""A table of measurements of one's own: what each row says, checked as far as the table alone can tell."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.rows import Chunk, broken, chunks_of
from quietfix.diagrams.readers.stamps import BadStamp, read_stamps
from quietfix.diagrams.schema.errors import UserError, shown

__all__ = ["COLUMNS", "MeasurementTable", "Series", "numbers_of", "read_measurements", "texts_of", "times_of"]

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

COLUMNS = ("time", "time_s", "target", "kind", "receiver", "reference", "value", "unit", "sigma")
"""Names of the columns; others are left out, and that is said."""

_NEEDED = ("kind", "value", "unit")
_WORDS = "time (with its zone) or time_s, kind, value, unit; as needed target, receiver, reference, sigma"
_FARTHEST = 1e15
_LIKELY = 0.75  # a name as near as this to one of a column is a mistake in writing


class Series(NamedTuple):
    """What rows of a table have in common."""

    target: str
    kind: str
    receiver: str
    reference: str
    unit: str


@dataclass(frozen=True, eq=False)
class MeasurementTable:
    """The rows of a table, in its order.

    Attributes
    ----------
    path : Path
    lines : ndarray of int, shape (rows,)
        Where each is in its file.
    whole : ndarray of int, shape (rows,), or None
        Seconds of TAI since 1970; None: the table has ``time_s``.
    rest : ndarray, shape (rows,)
        What is to be added [s]; without `whole` all of the time.
    which : ndarray of int, shape (rows,)
        Number of its series.
    series : list of Series
    value : ndarray, shape (rows,)
        In its own unit; NaN: missing.
    sigma : ndarray, shape (rows,)
        In the same unit; NaN: not said.
    notes : list of str
        What is doubtful.
    """

    path: Path
    lines: Numbers
    whole: Numbers | None
    rest: Array
    which: Numbers
    series: list[Series]
    value: Array
    sigma: Array
    notes: list[str]

    def wrong(self, row: int, message: str) -> UserError:
        """Return the error for a row."""
        return broken(self.path, int(self.lines[row]), message)

    def seconds(self, start: tuple[int, float] | None) -> Array:
        """Return the time of each row since a start in seconds of TAI since 1970; without one since the first [s]."""
        if self.whole is None:
            return self.rest
        whole, rest = start or self.first
        return (self.whole - whole) + (self.rest - rest)

    @property
    def first(self) -> tuple[int, float]:
        """The first time, in seconds of TAI since 1970, whole ones and the rest."""
        assert self.whole is not None
        at = int(np.lexsort((self.rest, self.whole))[0])
        return int(self.whole[at]), float(self.rest[at])


def read_measurements(path: Path) -> MeasurementTable:
    """Read a table of measurements, as text with any delimiter or as Parquet.

    Raises
    ------
    UserError
        In one line with file, line, column, value and what is allowed.
    """
    numbers: dict[tuple[str, ...], int] = {}
    parts: list[tuple[Any, ...]] = []
    notes: list[str] = []
    for chunk in chunks_of(path, _known, _WORDS):
        if not parts:
            notes += [*chunk.notes, *_left_out(path, chunk)]
        parts.append(_read(path, chunk, numbers))
    lines, rest, which, value, sigma = (np.concatenate([part[i] for part in parts]) for i in (0, 2, 3, 4, 5))
    whole = None if parts[0][1] is None else np.concatenate([part[1] for part in parts])
    if not lines.size:
        raise broken(path, None, "it has no rows; at least one measurement")
    if not np.isfinite(value).any():
        raise broken(path, None, "column value has no number in any row; at least one measurement")
    series = [Series(*key) for key in numbers]
    return MeasurementTable(path, lines, whole, rest, which, series, value, sigma, notes)


def _known(names: Sequence[str]) -> bool:
    return set(_NEEDED) <= set(names) and bool({"time", "time_s"} & set(names))


def _left_out(path: Path, chunk: Chunk) -> list[str]:
    """Return a note on columns that mean nothing; refuse those that are nearly one that does."""
    names = list(chunk.columns)
    if {"time", "time_s"} <= set(names):
        raise broken(path, None, "columns time and time_s are not allowed both; one of them")
    others = [name for name in names if name not in COLUMNS]
    for name in others:
        near = difflib.get_close_matches(name, COLUMNS, n=1, cutoff=_LIKELY)
        if near and near[0] not in names:
            raise broken(
                path, None, f"column {name} is not known (did you mean {near[0]}?); there are {', '.join(COLUMNS)}"
            )
    return [f"{shown(path)}: left out: column {', '.join(others)}."] if others else []


def _read(path: Path, chunk: Chunk, numbers: dict[tuple[str, ...], int]) -> tuple[Any, ...]:
    """Return lines, times, numbers of series, values and sigmas of some rows."""
    columns, count = chunk.columns, len(chunk.lines)
    lines = np.asarray(chunk.lines, dtype=np.int64)
    whole, rest = times_of(path, chunk)
    empty = [""] * count
    texts = [texts_of(columns.get(name, empty)) for name in Series._fields]
    which = np.fromiter((numbers.setdefault(key, len(numbers)) for key in zip(*texts, strict=True)), np.int64, count)
    value = numbers_of(path, chunk, "value")
    sigma = numbers_of(path, chunk, "sigma") if "sigma" in columns else np.full(count, np.nan)
    for i in np.flatnonzero(sigma <= 0)[:1]:
        raise broken(path, int(lines[i]), f"sigma: {sigma[i]:g} is not allowed; > 0, or empty: as the sensor has it")
    return lines, whole, rest, which, value, sigma


def texts_of(column: Any) -> list[str]:
    """Return texts; of a column of numbers such as numbers of aircraft these, without a decimal point."""
    if isinstance(column, list):
        return column
    return ["" if np.isnan(one) else f"{one:.0f}" if one == int(one) else repr(float(one)) for one in column]


def times_of(path: Path, chunk: Chunk) -> tuple[Numbers | None, Array]:
    """Return times as seconds of TAI since 1970, whole and rest; of ``time_s`` None and these.

    Raises
    ------
    UserError
        With file and line.
    """
    if "time_s" in chunk.columns:
        seconds = numbers_of(path, chunk, "time_s")
        for i in np.flatnonzero(np.isnan(seconds))[:1]:
            raise broken(path, chunk.lines[i], "time_s: nothing is not allowed; seconds")
        return None, seconds
    column = chunk.columns["time"]
    if not isinstance(column, list):
        raise broken(path, None, "time: numbers are not allowed; dates with their zone, or column time_s")
    try:
        return read_stamps(column)
    except BadStamp as error:
        raise broken(path, chunk.lines[error.at], f"time: {error}") from error


def numbers_of(path: Path, chunk: Chunk, name: str) -> Array:
    """Return a column of numbers; NaN where it is empty or says so."""
    column = chunk.columns[name]
    if isinstance(column, list):
        filled = ["nan" if text == "" else text for text in column]
        try:
            numbers = np.array(filled, dtype=float) if filled else np.empty(0)
        except ValueError:
            i = next(i for i, text in enumerate(filled) if not _is_number(text))
            comma = " with a decimal point" if "," in filled[i] else ""
            raise broken(path, chunk.lines[i], f"{name}: {filled[i]!r:.60} is not allowed; a number{comma}") from None
    else:
        numbers = np.asarray(column, dtype=float)
    for i in np.flatnonzero(np.abs(numbers) > _FARTHEST)[:1]:
        raise broken(path, chunk.lines[i], f"{name}: {numbers[i]:g} is not allowed; a number up to {_FARTHEST:g}")
    return numbers


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
