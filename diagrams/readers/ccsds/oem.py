"""Orbit Ephemeris Messages (CCSDS 502.0-B-3, also versions 1.0 and 2.0) in keyword = value notation."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.ccsds.kvn import KvnLine, KvnText, brief
from quietfix.diagrams.readers.ccsds.oem_covariance import Covariance, read_covariances
from quietfix.diagrams.readers.ccsds.oem_keywords import HEADER, MANDATORY, METADATA
from quietfix.diagrams.readers.ccsds.oem_rows import EphemerisRows

__all__ = ["EphemerisMessage", "EphemerisSegment", "read_oem"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_VERSIONS = ("1.0", "2.0", "3.0")
_TIMES = ("START_TIME", "USEABLE_START_TIME", "USEABLE_STOP_TIME", "STOP_TIME")
_SLACK = 1.0  # s, between a time in the metadata, which some round, and the ephemeris


@dataclass(frozen=True, eq=False)
class EphemerisSegment:
    """An ephemeris that may be interpolated from its beginning to its end.

    Attributes
    ----------
    metadata : dict of str to str
        All keywords and their values.
    second : ndarray of int, shape (k,)
        Epochs, strictly increasing: whole seconds of TAI since 1970; see `quietfix.systems.earth.time_scales`.
    rest : ndarray, shape (k,)
        And the rest [s].
    states : ndarray, shape (k, 6)
        Position [km] and velocity [km/s] as written.
    accelerations : ndarray, shape (k, 3)
        [km/s^2]; NaN where there is none.
    covariances : tuple of Covariance
    comments, data_comments : tuple of str
        Of the metadata and of what follows.
    """

    metadata: Mapping[str, str]
    second: Integers
    rest: Array
    states: Array
    accelerations: Array
    covariances: tuple[Covariance, ...] = ()
    comments: tuple[str, ...] = ()
    data_comments: tuple[str, ...] = ()

    def __eq__(self, other: object) -> bool:
        """Tell whether all of it is equal."""
        if not isinstance(other, EphemerisSegment):
            return NotImplemented
        columns = ("second", "rest", "states", "accelerations")
        same = (np.array_equal(getattr(self, one), getattr(other, one), equal_nan=True) for one in columns)
        texts = ("metadata", "covariances", "comments", "data_comments")
        return all(same) and all(getattr(self, one) == getattr(other, one) for one in texts)

    __hash__ = None  # type: ignore[assignment]


@dataclass(frozen=True)
class EphemerisMessage:
    """A message: one object, one or more segments that must not be interpolated across.

    Attributes
    ----------
    header : dict of str to str
        CREATION_DATE, ORIGINATOR, and CLASSIFICATION and MESSAGE_ID where they are.
    segments : tuple of EphemerisSegment
    comments : tuple of str
        Of the header.
    version : str
        Of the standard: 1.0, 2.0 or 3.0.
    """

    header: Mapping[str, str]
    segments: tuple[EphemerisSegment, ...]
    comments: tuple[str, ...] = ()
    version: str = "3.0"


def read_oem(path: Path | str) -> EphemerisMessage:
    """Read an Orbit Ephemeris Message.

    Time systems are UTC, TAI, GPS and TT. A row that is there twice in a row, all digits equal, is one.

    Raises
    ------
    UserError
        Naming file, line, keyword, value and what is allowed: for what the standard does not know, what is missing,
        epochs that do not increase, an ephemeris that does not reach from START_TIME to STOP_TIME (or the useable
        ones), and a file that ends in the middle.
    """
    text = KvnText(path)
    lines = text.lines()
    version = text.version(next(lines, None), "OEM", _VERSIONS)
    header, comments, line = text.header(lines, HEADER, HEADER[1:3])
    segments: list[EphemerisSegment] = []
    while line is not None:
        segment, line = _segment(text, lines, line)
        if segments and segment.metadata["TIME_SYSTEM"] != segments[0].metadata["TIME_SYSTEM"]:
            text.refuse(None, f"TIME_SYSTEM {segment.metadata['TIME_SYSTEM']} is not allowed; one in all segments")
        segments.append(segment)
    if not segments:
        text.refuse(None, "it ends before the first META_START")
    return EphemerisMessage(header, tuple(segments), comments, version)


def _segment(text: KvnText, lines: Iterator[KvnLine], first: KvnLine) -> tuple[EphemerisSegment, KvnLine | None]:
    """Return a segment and the line after it."""
    if first.keyword != "META_START" or first.value:
        text.refuse(first.number, f"{brief(first.text)} is not allowed; META_START")
    metadata, times, comments = _metadata(text, lines, first.number)
    rows = EphemerisRows(text, metadata["TIME_SYSTEM"])
    data_comments: list[str] = []
    line = None
    for line in lines:
        if line.keyword == "COMMENT":
            data_comments.append(line.value)
        elif line.keyword in ("META_START", "COVARIANCE_START") and not line.value:
            break
        else:
            rows.add(line)
    else:
        rows.check_end()
        line = None
    second, rest, states, accelerations = rows.columns(first.number)
    _check_span(text, times, rows, first.number)
    covariances: tuple[Covariance, ...] = ()
    if line is not None and line.keyword == "COVARIANCE_START":
        covariances = read_covariances(text, lines, line, metadata)
        line = _after(lines, data_comments)
    columns = second, rest, states, accelerations
    return EphemerisSegment(metadata, *columns, covariances, comments, tuple(data_comments)), line


def _after(lines: Iterator[KvnLine], comments: list[str]) -> KvnLine | None:
    """Return the next line that is no comment."""
    for line in lines:
        if line.keyword != "COMMENT":
            return line
        comments.append(line.value)
    return None


def _metadata(
    text: KvnText, lines: Iterator[KvnLine], begin: int
) -> tuple[dict[str, str], dict[str, tuple[int, float]], tuple[str, ...]]:
    """Return metadata, the moments in it, and comments."""
    found, comments = text.metadata(lines, begin, METADATA)
    text.required(begin, found, MANDATORY, f"in the metadata from line {begin}")
    metadata = {name: line.value for name, line in found.items()}
    scale = metadata["TIME_SYSTEM"] = text.scale(found["TIME_SYSTEM"].number, metadata["TIME_SYSTEM"])
    if "INTERPOLATION" in found:
        text.required(begin, found, ["INTERPOLATION_DEGREE"], "beside INTERPOLATION")
    if "INTERPOLATION_DEGREE" in found:
        text.integer(found["INTERPOLATION_DEGREE"].number, "INTERPOLATION_DEGREE", metadata["INTERPOLATION_DEGREE"], 1)
    moments = {}
    for name in ("REF_FRAME_EPOCH", *_TIMES):
        if name in found:
            moments[name] = text.epoch(found[name].number, name, metadata[name], scale)
    ordered = [name for name in _TIMES if name in moments]
    for sooner, later in pairwise(ordered):
        if moments[later] < moments[sooner]:
            text.refuse(found[later].number, f"{later} {brief(metadata[later])} is not allowed; not before {sooner}")
    return metadata, moments, comments


def _check_span(text: KvnText, times: Mapping[str, tuple[int, float]], rows: EphemerisRows, begin: int) -> None:
    """Refuse rows that do not cover what the metadata say: the file may be cut."""
    step = rows.shortest_step()
    slack = min(_SLACK, 0.5 * step) if step else _SLACK
    for name, number, sign in (("START_TIME", 0, 1), ("STOP_TIME", -1, -1)):
        wanted = times.get(f"USEABLE_{name}", times[name])
        line, there = rows.epoch(number)
        if sign * (there[0] - wanted[0] + (there[1] - wanted[1])) > slack:
            which = f"USEABLE_{name}" if f"USEABLE_{name}" in times else name
            what = "begins after" if sign > 0 else "ends before"
            text.refuse(line, f"the ephemeris {what} the {which} of the metadata from line {begin}; is the file cut?")
