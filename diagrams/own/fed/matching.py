"""Which rows of which sensors the rows of a table are, and what they are in SI units."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.own.kinds.kind import Alias, Row
from quietfix.diagrams.readers.measurements import MeasurementTable, Series
from quietfix.diagrams.readers.units import factor_of
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.systems.angles.bearing import from_compass

__all__ = ["Matched", "Meaning", "beyond", "matched", "meaning_of"]

Array = NDArray[np.float64]

_DBW = 30.0  # dBm


@dataclass(frozen=True, eq=False)
class Matched:
    """Rows of a table as rows of sensors.

    Attributes
    ----------
    row : ndarray of int, shape (rows of the table,)
        Which of the sensors' rows.
    value, sigma : ndarray
        SI units; NaN: missing, not said.
    notes : list of str
        What a reader of the results must know.
    """

    row: NDArray[np.int64]
    value: Array
    sigma: Array
    notes: list[str]


@dataclass(frozen=True)
class Meaning:
    """How a series becomes a row: its number, and value times factor plus offset."""

    row: int
    factor: float
    offset: float = 0.0
    compass: bool = False

    def value(self, value: float) -> float:
        """Return what a value is in SI units, to the bit as `matched` has it."""
        found = value * self.factor
        if self.compass:
            found = float(from_compass(np.degrees(np.array([found])))[0])
        return found + self.offset if self.offset else found


def matched(table: MeasurementTable, rows: Sequence[Row]) -> Matched:
    """Return what the rows of a table are.

    Raises
    ------
    UserError
        With file, line, column and value, for kinds, receivers, references that no sensor has, units of something else,
        and values that cannot be.
    """
    first = np.unique(table.which, return_index=True)[1]
    meanings = [_meaning(table, int(first[i]), one, rows) for i, one in enumerate(table.series)]
    row = np.array([one.row for one in meanings])[table.which]
    factor = np.array([one.factor for one in meanings])[table.which]
    offset = np.array([one.offset for one in meanings])[table.which]
    compass = np.array([one.compass for one in meanings])[table.which]
    value, sigma = table.value * factor, table.sigma * np.abs(factor)
    turned = value.copy()  # before it is wrapped, after which any number is a direction
    value[compass] = from_compass(np.degrees(value[compass]))
    value = np.where(offset == 0, value, value + offset)
    _check(table, rows, row, np.where(compass, turned, value))
    return Matched(row, value, sigma, _notes(table, rows, row))


def _meaning(table: MeasurementTable, at: int, series: Series, rows: Sequence[Row]) -> Meaning:
    try:
        return meaning_of(series, rows)
    except UserError as error:
        raise table.wrong(at, str(error)) from error


def meaning_of(series: Series, rows: Sequence[Row]) -> Meaning:
    """Return which row a series is, and how its values become those of the row.

    Raises
    ------
    UserError
        For a kind, receiver or reference that no sensor has, and a unit of something else.
    """
    of_kind = {i: alias for i, row in enumerate(rows) for alias in _names(row) if alias.kind == series.kind}
    if not of_kind:
        choose("kind", series.kind, dict.fromkeys(one.kind for row in rows for one in _names(row)))
    i, sign = _found(series, rows, list(of_kind))
    row, alias = rows[i], of_kind[i]
    try:
        power = series.unit == "dBW" and row.unit == "dBm"
        factor = 1.0 if power else factor_of(series.unit, row.unit)
    except ValueError as error:
        raise UserError(f"unit: {error} for {row.name}") from error
    return Meaning(i, sign * factor, _DBW if power else alias.offset, alias.compass)


def _names(row: Row) -> list[Alias]:
    """Return what a table may call a row, its own kind first."""
    return [Alias(row.kind), *row.aliases]


def _found(series: Series, rows: Sequence[Row], of_kind: Sequence[int]) -> tuple[int, float]:
    """Return the number of a series' row, and -1 where receiver and reference are the other way round."""
    for i in of_kind:
        row = rows[i]
        if (row.receiver, row.reference) == (series.receiver, series.reference):
            return i, 1.0
    for i in of_kind:
        row = rows[i]
        if row.reference and (row.reference, row.receiver) == (series.receiver, series.reference):
            return i, -1.0
    mine = [rows[i] for i in of_kind]
    receivers = dict.fromkeys(row.receiver for row in mine)
    if series.receiver not in receivers:
        choose("receiver", series.receiver or "''", [name or "'' (none)" for name in receivers])
    references = dict.fromkeys(row.reference for row in mine if row.receiver == series.receiver)
    raise UserError(
        f"reference: {series.reference[:60] or 'nothing'} is not allowed for {series.kind} at {series.receiver}; "
        f"{', '.join(name or 'nothing' for name in references)}"
    )


def _check(table: MeasurementTable, rows: Sequence[Row], row: NDArray[np.int64], value: Array) -> None:
    """Refuse what cannot be: mostly a unit that is another one than the table says."""
    for i, one in enumerate(rows):
        if not one.largest:
            continue
        for k in np.flatnonzero((row == i) & (np.abs(value) > one.largest))[:1]:
            raise table.wrong(int(k), beyond(one, float(value[k]), float(table.value[k]), table.series[table.which[k]]))


def beyond(row: Row, value: float, written: float, series: Series) -> str:
    """Return what is wrong with a value (SI units) that cannot be, as it is written; empty where it can."""
    if not row.largest or not abs(value) > row.largest:
        return ""
    return f"value: {written:g} {series.unit} is not allowed for {row.name}; {row.largest_words}"


def _notes(table: MeasurementTable, rows: Sequence[Row], row: NDArray[np.int64]) -> list[str]:
    notes = []
    if any(one.kind == "azimuth" for one in table.series) and any(one.compass for one in rows):
        notes.append("azimuth: taken as counter-clockwise from east (clockwise from north is kind bearing).")
    absent = [one.name for i, one in enumerate(rows) if not np.any(row == i)]
    if absent:
        notes.append(f"{table.path.name}: it has no rows of {', '.join(absent)}.")
    return notes
