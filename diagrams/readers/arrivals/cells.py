"""Rows of a table as text, whatever its delimiter, the order of its columns and their usual other names."""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.files import Unreadable, read_text

__all__ = ["Names", "cell_rows", "header_of", "identifier", "number", "optional_number"]

Names = Mapping[str, Sequence[str]]
"""By what a column is called here all names that it may have: small letters and digits only, the best one first."""

_DELIMITERS = (",", ";", "\t", "|")
_NOTHING = {"", "nan", "null", "none", "na", "n/a", "-"}
_LARGEST = 1e6  # deg or m


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _found(header: Sequence[str], wanted: Names) -> dict[str, int]:
    """Return where columns are that are there, by what they are called here."""
    plain = [_plain(name) for name in header]
    found: dict[str, int] = {}
    for name, others in wanted.items():
        at = next((plain.index(other) for other in others if other in plain), None)
        if at is not None and at not in found.values():
            found[name] = at
    return found


def _split(line: str, delimiter: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    except csv.Error:
        return []


def _delimiter(line: str, wanted: Names) -> str:
    """Return the delimiter with which a line has most of the names; a comma where none has any."""
    return max(_DELIMITERS, key=lambda one: len(_found(_split(line, one), wanted)))


def header_of(file: Path, wanted: Names) -> set[str]:
    """Return which columns the first line of a file names, by what they are called here; nothing if it is no text."""
    try:
        text = read_text(file, encoding="utf-8-sig")
    except Unreadable:
        return set()
    line = next((one for one in text.splitlines() if one.strip() and not one.startswith("#")), "")
    return set(_found(_split(line, _delimiter(line, wanted)), wanted))


def cell_rows(file: Path, wanted: Names, needed: Sequence[str]) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield where a row is, for messages, and its cells by what their columns are called here.

    Parameters
    ----------
    file : Path
        Text in UTF-8; delimiter comma, semicolon, tab or bar; empty lines and lines that begin with ``#`` are no rows.
    wanted : mapping of str to sequence of str
        See `Names`; columns that are not there have no cells.
    needed : sequence of str
        Columns that must be there.

    Raises
    ------
    UserError
        If the file cannot be read, lacks a column, or a row has too few or too many cells.
    """
    try:
        text = read_text(file, encoding="utf-8-sig")
    except Unreadable as error:
        raise UserError(f"{file}: it cannot be read ({error.reason})") from error
    lines = text.splitlines(keepends=True)
    skipped = next((i for i, one in enumerate(lines) if one.strip() and not one.startswith("#")), len(lines))
    first = lines[skipped] if skipped < len(lines) else ""
    delimiter = _delimiter(first, wanted)
    with io.StringIO("".join(lines[skipped:]), newline="") as stream:
        reader = csv.reader(stream, delimiter=delimiter, strict=True, skipinitialspace=True)
        try:
            header = [name.strip() for name in next(reader, [])]
            at = _found(header, wanted)
            absent = [name for name in needed if name not in at]
            if absent:
                raise UserError(f"{file}: column {absent[0]} is missing; there are {', '.join(header) or 'none'}")
            for row in reader:
                if not row or row[0].startswith("#"):
                    continue
                where = f"{file} line {skipped + reader.line_num}"
                if len(row) != len(header):
                    raise UserError(f"{where}: it does not have {len(header)} cells, as the first line")
                yield where, {name: row[i].strip() for name, i in at.items()}
        except csv.Error as error:
            raise UserError(f"{file}: it is not a CSV file ({error})") from error


def identifier(text: str | int) -> int | str:
    """Return a whole number for what is written as one, else the text: ``7`` is 7, ``007`` and ``DLH4A`` are texts."""
    try:
        whole = int(text)
    except ValueError:
        return text
    return whole if str(whole) == str(text) else text


def number(where: str, row: Mapping[str, str], column: str) -> float:
    """Return a number of a row.

    Raises
    ------
    UserError
        If it is none, or too large.
    """
    try:
        value = float(row[column])
    except ValueError:
        value = math.nan
    if not abs(value) <= _LARGEST:
        raise UserError(
            f"{where}: {column}: {row[column]!r} is not allowed; a finite number, at most {_LARGEST:g} in size"
        )
    return value


def optional_number(where: str, row: Mapping[str, str], column: str) -> float:
    """Return a number of a row; NaN where the cell, or the column, says nothing."""
    return math.nan if row.get(column, "").lower() in _NOTHING else number(where, row, column)
