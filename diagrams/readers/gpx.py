"""Tracks in the GPS Exchange Format (GPX 1.0 and 1.1, topografix.com/GPX/1/1)."""

from __future__ import annotations

import math
import re
from array import array
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.schema.errors import UserError, shown
from quietfix.systems.earth.time_scales import to_tai
from quietfix.systems.files import Unreadable, read_bytes

__all__ = ["GpxTrack", "read_gpx"]

Array = NDArray[np.float64]

_LARGEST_FILE = 128_000_000  # bytes: a million points
_DEEPEST = 32
_LONGEST = 1000  # characters of a text that is kept
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[Ee][+-]?\d{1,3})?", re.ASCII)
_FARTHEST = 1e8  # m
_HEIGHTS = ("ele", "geoidheight")


@dataclass(frozen=True, eq=False)
class GpxTrack:
    """A track: where something was, in the order of the file.

    Attributes
    ----------
    name : str
        Empty: it has none.
    second : ndarray of int, shape (k,)
        Whole seconds of TAI since 1970; see `quietfix.systems.earth.time_scales`.
    rest : ndarray, shape (k,)
        And the rest [s].
    latitude, longitude : ndarray, shape (k,)
        On WGS 84 [deg].
    elevation : ndarray, shape (k,)
        As written [m], above the geoid as most receivers give it; NaN: not said.
    geoid : ndarray, shape (k,)
        Height of the geoid above the ellipsoid [m], where the file says it; else NaN.
    part : ndarray of int, shape (k,)
        Number of the segment, from 0: between two of them the receiver was off or saw no satellites.
    """

    name: str
    second: NDArray[np.int64]
    rest: Array
    latitude: Array
    longitude: Array
    elevation: Array
    geoid: Array
    part: NDArray[np.int64]

    def __eq__(self, other: object) -> bool:
        """Tell whether all of it is equal."""
        if not isinstance(other, GpxTrack):
            return NotImplemented
        columns = ("second", "rest", "latitude", "longitude", "elevation", "geoid", "part")
        same = (np.array_equal(getattr(self, one), getattr(other, one), equal_nan=True) for one in columns)
        return self.name == other.name and all(same)

    __hash__ = None  # type: ignore[assignment]


@dataclass
class _Point:
    line: int
    latitude: float
    longitude: float
    heights: dict[str, float] = field(default_factory=dict)
    moment: tuple[int, float] | None = None


class _Reader:
    """What is read so far: called by expat for each element. A DTD, and with it any entity, is refused."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.tracks: list[GpxTrack] = []
        self._parser = expat.ParserCreate()
        self._parser.buffer_text = True
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text
        self._parser.StartDoctypeDeclHandler = lambda *declared: self.refuse("a DTD is not allowed")
        self._where: list[str] = []
        self._said = ""
        self._point: _Point | None = None
        self._begin("")

    def read(self, content: bytes) -> None:
        try:
            self._parser.Parse(content, True)
        except expat.ExpatError as error:
            self.refuse(f"it is no XML ({expat.errors.messages[error.code]})", error.lineno)
        except (LookupError, ValueError) as error:  # an encoding that there is not, or that is no text
            if isinstance(error, UserError):
                raise
            self.refuse(f"it is no XML ({error})")

    def refuse(self, reason: str, line: int | None = None) -> NoReturn:
        raise UserError(f"{shown(self.path)}, line {line or self._parser.CurrentLineNumber}: {reason}")

    def _begin(self, name: str) -> None:
        self._name, self._part = name, -1
        self._integers = {one: array("q") for one in ("second", "part")}
        self._numbers = {one: array("d") for one in ("rest", "latitude", "longitude", "elevation", "geoid")}

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        name = tag.rpartition(":")[2]
        if not self._where and name != "gpx":
            self.refuse(f"<{name[:40]}> is not allowed; a GPX file begins with <gpx>")
        self._where.append(name)
        if len(self._where) > _DEEPEST:
            self.refuse(f"elements more than {_DEEPEST} deep are not allowed")
        self._said = ""
        if self._where == ["gpx", "trk"]:
            self._begin("")
        elif self._where == ["gpx", "trk", "trkseg"]:
            self._part += 1
        elif self._where == ["gpx", "trk", "trkseg", "trkpt"]:
            latitude, longitude = self._degrees(attributes, "lat", 90.0), self._degrees(attributes, "lon", 180.0)
            self._point = _Point(self._parser.CurrentLineNumber, latitude, longitude)

    def _degrees(self, attributes: dict[str, str], name: str, most: float) -> float:
        if name not in attributes:
            self.refuse(f"{name} is missing in <trkpt>; -{most:g} to {most:g}")
        return self._number(name, attributes[name], most, f"-{most:g} to {most:g}")

    def _number(self, name: str, value: str, most: float, allowed: str) -> float:
        found = float(value) if _NUMBER.fullmatch(value.strip()) else math.nan
        if not abs(found) <= most:
            self.refuse(f"{name} {value[:60]!r} is not allowed; {allowed}")
        return found

    def _text(self, text: str) -> None:
        if len(self._said) <= _LONGEST:
            self._said += text

    def _end(self, tag: str) -> None:
        name, where, said = tag.rpartition(":")[2], self._where, self._said.strip()[:_LONGEST]
        if len(where) == 5 and where[3] == "trkpt" and self._point is not None:
            if name in _HEIGHTS:
                self._point.heights[name] = self._number(name, said, _FARTHEST, "metres")
            elif name == "time":
                self._point.moment = self._moment(said)
        elif where == ["gpx", "trk", "trkseg", "trkpt"]:
            self._add()
        elif where == ["gpx", "trk", "name"]:
            self._name = said
        elif where == ["gpx", "trk"]:
            self._finish()
        where.pop()
        self._said = ""

    def _moment(self, said: str) -> tuple[int, float]:
        try:
            return to_tai(said, offsets=True)
        except ValueError as error:
            self.refuse(f"time {error}")

    def _add(self) -> None:
        point, self._point = self._point, None
        assert point is not None
        if point.moment is None:
            self.refuse("a <trkpt> without <time> is not allowed: when was it there?", point.line)
        second, rest = point.moment
        integers, numbers = self._integers, self._numbers
        row = [rest, point.latitude, point.longitude, *(point.heights.get(one, math.nan) for one in _HEIGHTS)]
        if integers["second"]:
            before = integers["second"][-1], numbers["rest"][-1]
            if (second, rest) < before:
                self.refuse("its time is before that of the point before it; in the order of time", point.line)
            if (second, rest) == before:
                if np.array_equal(row, [one[-1] for one in numbers.values()], equal_nan=True):
                    return
                self.refuse("its time is that of the point before it, which is somewhere else; one of them", point.line)
        integers["second"].append(second)
        integers["part"].append(self._part)
        for column, one in zip(numbers.values(), row, strict=True):
            column.append(one)

    def _finish(self) -> None:
        if not self._integers["second"]:
            return
        second, part = (np.array(column, dtype=np.int64) for column in self._integers.values())
        numbers = {name: np.array(column) for name, column in self._numbers.items()}
        self.tracks.append(GpxTrack(self._name, second, part=part - part[0], **numbers))


def read_gpx(path: Path | str) -> list[GpxTrack]:
    """Read the tracks of a GPX file that have points; waypoints and routes are left out: they have no times.

    Times have a ``Z``, an offset from UTC, or none and are UTC. A point that is there twice in a row is one.

    Raises
    ------
    UserError
        Naming file, line, value and what is allowed: for what is no XML or no GPX, a DTD, places and times that cannot
        be, points without a time or out of order, and a file without a track.
    """
    file = Path(path)
    try:
        content = read_bytes(file, _LARGEST_FILE)
    except Unreadable as error:
        raise UserError(f"{shown(file)} cannot be read ({error.reason})") from error
    reader = _Reader(file)
    reader.read(content)
    if not reader.tracks:
        raise UserError(f"{shown(file)}: it has no track; <trk> with <trkpt lat=... lon=...> and <time>")
    return reader.tracks
