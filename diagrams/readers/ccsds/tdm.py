"""Tracking Data Messages (CCSDS 503.0-B-2, also version 1.0) in keyword = value notation."""

from __future__ import annotations

import math
import sys
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.ccsds.kvn import KvnLine, KvnText, brief
from quietfix.diagrams.readers.ccsds.tdm_keywords import (
    CHOICES,
    CORRECTIONS,
    DATA,
    HEADER,
    INTEGERS,
    METADATA,
    NUMBERS,
    PHASES,
)

__all__ = ["TrackingMessage", "TrackingRecords", "TrackingSegment", "read_tdm"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_VERSIONS = ("1.0", "2.0")
_INDEXED = ("RECEIVE_FREQ", "TRANSMIT_FREQ", "TRANSMIT_FREQ_RATE", "RECEIVE_PHASE_CT", "TRANSMIT_PHASE_CT")


@dataclass(frozen=True, eq=False)
class TrackingRecords:
    """The records of a data section, in the order of the file.

    Attributes
    ----------
    keywords : tuple of str
        What each is: RANGE, ANGLE_1, RECEIVE_FREQ_1 ...
    second : ndarray of int, shape (k,)
        Time tags: whole seconds of TAI since 1970; see `quietfix.systems.earth.time_scales`.
    rest : ndarray, shape (k,)
        And the rest [s].
    value : ndarray, shape (k,)
        In the standard's units (km, km/s, Hz, deg, s ...), as written: nothing is added.
    digits : dict of int to str
        The values that have more digits than a number here (phase counts), by row.
    line : ndarray of int, shape (k,)
        Where each was in a file; equal records may have been elsewhere. Empty: nowhere.
    """

    keywords: tuple[str, ...]
    second: Integers
    rest: Array
    value: Array
    digits: Mapping[int, str] = field(default_factory=dict)
    line: Integers = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    def __eq__(self, other: object) -> bool:
        """Tell whether all records are equal."""
        return (
            isinstance(other, TrackingRecords)
            and self.keywords == other.keywords
            and self.digits == other.digits
            and np.array_equal(self.second, other.second)
            and np.array_equal(self.rest, other.rest)
            and np.array_equal(self.value, other.value)
        )

    __hash__ = None  # type: ignore[assignment]


@dataclass(frozen=True)
class TrackingSegment:
    """What was tracked in one configuration.

    Attributes
    ----------
    metadata : dict of str to str
        All keywords of the metadata section and their values; words of the standard in its spelling.
    records : TrackingRecords
    comments, data_comments : tuple of str
        Of the metadata section and of the data section.
    """

    metadata: Mapping[str, str]
    records: TrackingRecords
    comments: tuple[str, ...] = ()
    data_comments: tuple[str, ...] = ()

    def participants(self, path: str = "PATH") -> tuple[str, ...]:
        """Return the participants along a signal path, the transmitter first; none without that keyword."""
        if path not in self.metadata:
            return ()
        return tuple(self.metadata[f"PARTICIPANT_{n}"] for n in self.metadata[path].split(","))


@dataclass(frozen=True)
class TrackingMessage:
    """A message.

    Attributes
    ----------
    header : dict of str to str
        CREATION_DATE, ORIGINATOR and MESSAGE_ID, as written.
    segments : tuple of TrackingSegment
    comments : tuple of str
        Of the header.
    version : str
        Of the standard: 1.0 or 2.0.
    """

    header: Mapping[str, str]
    segments: tuple[TrackingSegment, ...]
    comments: tuple[str, ...] = ()
    version: str = "2.0"


def read_tdm(path: Path | str) -> TrackingMessage:
    """Read a Tracking Data Message.

    Time systems are UTC, TAI, GPS and TT. Keywords may be in small letters, in any order, and a unit in brackets may
    follow a number if it is the standard's; the records of a keyword need not be in the order of time.

    Raises
    ------
    UserError
        Naming file, line, keyword, value and what is allowed: for what the standard does not know, what is missing, a
        keyword that is there twice, a record that is there twice, and a file that ends in the middle.
    """
    text = KvnText(path)
    lines = text.lines()
    version = text.version(next(lines, None), "TDM", _VERSIONS)
    header, comments, line = text.header(lines, HEADER, HEADER[:2])
    segments = []
    while line is not None:
        if line.keyword != "META_START":
            text.refuse(line.number, f"{brief(line.text)} is not allowed; META_START")
        segments.append(_segment(text, lines, line.number))
        line = next(lines, None)
    if not segments:
        text.refuse(None, "it ends before the first META_START")
    return TrackingMessage(header, tuple(segments), comments, version)


def _segment(text: KvnText, lines: Iterator[KvnLine], begin: int) -> TrackingSegment:
    found, comments = text.metadata(lines, begin, METADATA)
    metadata = {name: _checked(text, line) for name, line in found.items()}
    _check_metadata(text, metadata, begin)
    line = next(lines, None)
    if line is None or line.keyword != "DATA_START" or line.value:
        text.refuse(
            line.number if line else None, f"{brief(line.text) if line else 'its end'} is not allowed; DATA_START"
        )
    records, data_comments = _records(text, lines, metadata, line.number)
    return TrackingSegment(metadata, records, comments, data_comments)


def _checked(text: KvnText, line: KvnLine) -> str:
    """Return a value of the metadata in the standard's spelling."""
    name, value = line.keyword, line.value
    if name in CHOICES:
        inner = value[1:-1].strip() if name == "RANGE_UNITS" and value[:1] + value[-1:] == "[]" else value
        return text.choice(line.number, name, inner, CHOICES[name])
    if name == "TIME_SYSTEM":
        return text.scale(line.number, value)
    if name in NUMBERS:
        unit, least = NUMBERS[name]
        if text.number(line.number, name, value, unit) < least:
            limit = ">= 0" if least == 0 else "> 0"
            text.refuse(line.number, f"{name} {brief(value)} is not allowed; a number {limit}")
        return text.without_unit(line.number, name, value, unit)
    if name in INTEGERS:
        text.integer(line.number, name, value, 1)
    elif name in ("START_TIME", "STOP_TIME"):
        text.epoch(line.number, name, value, "UTC")
    elif name in ("PATH", "PATH_1", "PATH_2"):
        return _path(text, line)
    return value


def _path(text: KvnText, line: KvnLine) -> str:
    steps = [step.strip() for step in line.value.split(",")]
    known = all(step in ("1", "2", "3", "4", "5") for step in steps)
    if not known or len(steps) < 2 or any(a == b for a, b in pairwise(steps)):
        text.refuse(
            line.number, f"{line.keyword} {brief(line.value)} is not allowed; numbers of participants such as 1,2,1"
        )
    return ",".join(steps)


def _check_metadata(text: KvnText, metadata: Mapping[str, str], begin: int) -> None:
    """Refuse metadata that lack something or contradict themselves."""
    where = f"in the metadata from line {begin}"
    text.required(begin, metadata, ["TIME_SYSTEM"], where)
    if not any(name.startswith("PARTICIPANT_") for name in metadata):
        text.refuse(begin, f"PARTICIPANT_1 is missing {where}; at least one is needed")
    for name in ("PATH", "PATH_1", "PATH_2"):
        for n in metadata.get(name, "").split(","):
            if n and f"PARTICIPANT_{n}" not in metadata:
                text.refuse(begin, f"{name} {brief(metadata[name])} is not allowed; there is no PARTICIPANT_{n}")
    mode = metadata.get("MODE")
    wanted = {"SEQUENTIAL": ["PATH"], "SINGLE_DIFF": ["PATH_1", "PATH_2"]}.get(mode or "", [])
    if mode:
        for name in ("PATH", "PATH_1", "PATH_2"):
            if (name in metadata) != (name in wanted):
                text.refuse(begin, f"MODE {mode} needs {' and '.join(wanted)}, and no other path {where}")
    if any(name in metadata for name in CORRECTIONS):
        text.required(begin, metadata, ["CORRECTIONS_APPLIED"], where)


def _records(
    text: KvnText, lines: Iterator[KvnLine], metadata: Mapping[str, str], begin: int
) -> tuple[TrackingRecords, tuple[str, ...]]:
    keywords: list[str] = []
    number, second, rest, value = array("q"), array("q"), array("d"), array("d")
    digits: dict[int, str] = {}
    comments: list[str] = []
    for line in lines:
        name = line.keyword
        if name == "DATA_STOP" and not line.value:
            break
        if name == "COMMENT":
            comments.append(line.value)
            continue
        tag, found = _record(text, line, metadata)
        if name in PHASES:
            digits[len(keywords)] = line.value.split(None, 1)[1]
        keywords.append(sys.intern(name))
        number.append(line.number)
        second.append(tag[0])
        rest.append(tag[1])
        value.append(found)
    else:
        text.refuse(None, f"it ends before the DATA_STOP of line {begin}'s DATA_START")
    if not keywords:
        text.refuse(begin, "a data section without a record is not allowed")
    columns = np.array(second, dtype=np.int64), np.array(rest), np.array(value)
    records = TrackingRecords(tuple(keywords), *columns, digits, np.array(number, dtype=np.int64))
    _check_unique(text, records)
    return records, tuple(comments)


def _check_unique(text: KvnText, records: TrackingRecords) -> None:
    """Refuse two records of a keyword at the same time: 3.4.11 of the standard."""
    numbers = {name: i for i, name in enumerate(sorted(set(records.keywords)))}
    kind = np.array([numbers[name] for name in records.keywords])
    order = np.lexsort((records.rest, records.second, kind))
    same = [np.diff(one[order]) == 0 for one in (kind, records.second, records.rest)]
    twice = np.flatnonzero(np.all(same, axis=0))
    if twice.size:
        first, other = order[twice[0]], order[twice[0] + 1]
        again = f"{records.keywords[other]} of this time is in line {records.line[first]} too; once"
        text.refuse(int(records.line[other]), again)


def _record(text: KvnText, line: KvnLine, metadata: Mapping[str, str]) -> tuple[tuple[int, float], float]:
    """Return time tag and value of a record."""
    name = text.keyword(line, DATA, "in the data")
    unit, (least, most) = DATA[name]
    tag, *rest = line.value.split(None, 1)
    if not rest:
        text.refuse(line.number, f"{name} {brief(line.value)} is not allowed; a time tag, a blank and a number")
    moment = text.epoch(line.number, name, tag, metadata["TIME_SYSTEM"])
    unit = metadata.get("RANGE_UNITS", "km") if name == "RANGE" else unit
    number = text.number(line.number, name, rest[0], unit)
    if not least <= number <= most:
        text.refuse(line.number, f"{name} {brief(rest[0])} is not allowed; {_limits(least, most)}")
    stem, _, index = name.rpartition("_")
    if stem in _INDEXED and f"PARTICIPANT_{index}" not in metadata:
        text.refuse(line.number, f"{name} is not allowed; there is no PARTICIPANT_{index}")
    if name in ("ANGLE_1", "ANGLE_2") and "ANGLE_TYPE" not in metadata:
        text.refuse(line.number, f"{name} needs an ANGLE_TYPE in the metadata; {', '.join(CHOICES['ANGLE_TYPE'])}")
    return moment, number


def _limits(least: float, most: float) -> str:
    if math.isinf(most):
        return "a number >= 0" if least == 0 else "a number > 0"
    return "-180 to 360, without 360" if least == -180 else f"{least:g} to {most:g}"
