"""Reader of LocaRDS messages: arrival times of ADS-B messages at receivers with GPS clocks.

``sensors.csv`` says where the receivers are; ``set_*.csv`` has one message a line: ``aircraft``, its own ``latitude``,
``longitude``, ``baroAltitude`` and ``geoAltitude``, and ``measurements``, a list of [receiver, time of arrival in ns,
signal strength]. The clocks' common zero is arbitrary.

Schaefer, Strohmeier, Leonardi and Lenders, *LocaRDS: a localization reference data set*, Sensors 21 (2021) 5516,
doi 10.3390/s21165516.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.geodetic import geodetic_to_ecef
from quietfix.systems.files import Unreadable, read_text

__all__ = ["LocardsSet", "Receiver", "Track", "read_receivers", "read_set", "read_sets"]

Array = NDArray[np.float64]

_NS = 1e-9
_LARGEST = 1e6  # deg or m
_LATEST = 10**18  # ns; some 30 years
_DURATION = 120_000  # ns; what an aircraft sends takes so long, so two lines within it hold one message
_RECEIVER_COLUMNS = ("serial", "latitude", "longitude", "height")
_MESSAGE_COLUMNS = ("aircraft", "latitude", "longitude", "baroAltitude", "geoAltitude", "measurements")


class Receiver(NamedTuple):
    """Where a receiver stands: Earth-fixed position [m], shape (3,), and height [m]."""

    position: Array
    height: float


@dataclass(frozen=True)
class Track:
    """The messages of one aircraft, in the order of their arrival.

    Attributes
    ----------
    aircraft : int
        Number of the aircraft.
    times : ndarray, shape (messages,)
        Median time of arrival, from the first message of the set [s]; strictly increasing.
    arrivals : ndarray, shape (messages, receivers)
        Times of arrival minus the first-named receiver's [s]; NaN beyond the receivers that heard the message.
    platforms : ndarray, shape (messages, receivers, 6)
        Earth-fixed states of those receivers.
    heights : ndarray, shape (messages, receivers)
        Their heights [m].
    altitude : ndarray, shape (messages,)
        Barometric altitude [m]; NaN where not reported.
    reported : ndarray, shape (messages, 3)
        Truth, for scoring only: the aircraft's own latitude and longitude [rad] and geometric height [m].
    """

    aircraft: int
    times: Array
    arrivals: Array
    platforms: Array
    heights: Array
    altitude: Array
    reported: Array

    def part(self, which: slice) -> Track:
        """Return some of the messages as a track."""
        arrays = {name: value[which] for name, value in vars(self).items() if name != "aircraft"}
        return Track(self.aircraft, **arrays)


@dataclass(frozen=True)
class LocardsSet:
    """The tracks of one file.

    Attributes
    ----------
    name : str
        Name of the file, without its ending.
    tracks : list of Track
        One per aircraft.
    repeats : int
        Lines left out because they hold a message that another line has already.
    """

    name: str
    tracks: list[Track]
    repeats: int


class _Message(NamedTuple):
    aircraft: int
    stamp: int  # ns
    receivers: list[int]
    arrivals: list[int]  # ns
    altitude: float
    reported: tuple[float, float, float]


def read_sets(folder: Path) -> list[LocardsSet]:
    """Read all sets of a folder.

    Raises
    ------
    UserError
        If a file is missing or broken; it names file, line and what is allowed.
    """
    receivers = read_receivers(folder / "sensors.csv")
    files = sorted(folder.glob("set_*.csv"))
    if not files:
        raise UserError(f"{folder}: there is no file set_*.csv")
    return [read_set(file, receivers) for file in files]


def read_receivers(file: Path) -> dict[int, Receiver]:
    """Read where the receivers are; one at latitude 0, longitude 0 has no known place and is left out."""
    receivers = {}
    for where, row in _rows(file, _RECEIVER_COLUMNS):
        serial = _whole(where, row, "serial")
        latitude, longitude, height = (_number(where, row, column) for column in _RECEIVER_COLUMNS[1:])
        if latitude == 0 and longitude == 0:
            continue
        place = geodetic_to_ecef(math.radians(latitude), math.radians(longitude), height)
        receivers[serial] = Receiver(place, height)
    return receivers


def read_set(file: Path, receivers: Mapping[int, Receiver]) -> LocardsSet:
    """Read the messages of a set.

    Parameters
    ----------
    file : Path
        ``set_*.csv``.
    receivers : mapping of int to Receiver
        What `read_receivers` returned.
    """
    messages: list[_Message] = []
    for where, row in _rows(file, _MESSAGE_COLUMNS):
        messages.append(_message(where, row, receivers))
    if not messages:
        raise UserError(f"{file}: there are no messages in it")
    width = max(len(message.receivers) for message in messages)
    first = min(message.stamp for message in messages)
    aircraft: dict[int, list[_Message]] = defaultdict(list)
    repeats = 0
    for message in sorted(messages, key=lambda message: message.stamp):
        group = aircraft[message.aircraft]
        if group and message.stamp - group[-1].stamp < _DURATION:
            repeats += 1
        else:
            group.append(message)
    tracks = [_track(aircraft[number], receivers, width, first) for number in sorted(aircraft)]
    return LocardsSet(file.stem, tracks, repeats)


def _track(messages: list[_Message], receivers: Mapping[int, Receiver], width: int, first: int) -> Track:
    count = len(messages)
    arrivals = np.full((count, width), np.nan)
    platforms = np.full((count, width, 6), np.nan)
    heights = np.full((count, width), np.nan)
    for i, message in enumerate(messages):
        for j, (serial, arrival) in enumerate(zip(message.receivers, message.arrivals, strict=True)):
            # whole nanoseconds until here: a double resolves 1e-7 s after half an hour
            arrivals[i, j] = (arrival - message.arrivals[0]) * _NS
            platforms[i, j] = np.concatenate([receivers[serial].position, np.zeros(3)])
            heights[i, j] = receivers[serial].height
    return Track(
        messages[0].aircraft,
        np.array([(message.stamp - first) * _NS for message in messages]),
        arrivals,
        platforms,
        heights,
        np.array([message.altitude for message in messages]),
        np.array([message.reported for message in messages]),
    )


def _message(where: str, row: Mapping[str, str], receivers: Mapping[int, Receiver]) -> _Message:
    try:
        entries = json.loads(row["measurements"])
    except (ValueError, RecursionError) as error:
        raise UserError(f"{where}: measurements: {row['measurements']!r} is not a list ({error})") from error
    serials, arrivals = [], []
    for entry in entries if isinstance(entries, list) else [entries]:
        whole = isinstance(entry, list) and len(entry) >= 2 and all(type(value) is int for value in entry[:2])
        whole = whole and abs(entry[1]) < _LATEST
        if not whole:
            raise UserError(f"{where}: measurements: {entry!r} is not allowed; [receiver, arrival in ns, strength]")
        if entry[0] not in receivers:
            raise UserError(f"{where}: measurements: receiver {entry[0]} has no place in sensors.csv")
        serials.append(entry[0])
        arrivals.append(entry[1])
    if len(arrivals) < 2 or len(set(serials)) < len(serials):
        raise UserError(f"{where}: measurements: at least two different receivers are needed, there are {serials}")
    degrees = [_number(where, row, column, empty=math.nan) for column in ("latitude", "longitude")]
    barometric, geometric = (_number(where, row, c, empty=math.nan) for c in ("baroAltitude", "geoAltitude"))
    return _Message(
        _whole(where, row, "aircraft"),
        # the middle one: a receiver whose clock is wrong must not move the message in time
        sorted(arrivals)[len(arrivals) // 2],
        serials,
        arrivals,
        barometric,
        (math.radians(degrees[0]), math.radians(degrees[1]), geometric),
    )


def _rows(file: Path, columns: tuple[str, ...]) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield where a line is, for messages, and its cells."""
    try:
        with io.StringIO(read_text(file), newline="") as stream:
            reader = csv.DictReader(stream, strict=True)
            absent = [column for column in columns if column not in (reader.fieldnames or [])]
            if absent:
                there = ", ".join(reader.fieldnames or []) or "none"
                raise UserError(f"{file}: column {absent[0]} is missing; there are {there}")
            for row in reader:
                where = f"{file} line {reader.line_num}"
                if None in row or None in row.values():
                    raise UserError(
                        f"{where}: it does not have {len(reader.fieldnames or [])} cells, as the first line"
                    )
                yield where, row
    except Unreadable as error:
        raise UserError(f"{file}: it cannot be read ({error.reason})") from error
    except csv.Error as error:
        raise UserError(f"{file}: it is not a CSV file ({error})") from error


def _number(where: str, row: Mapping[str, Any], column: str, empty: float | None = None) -> float:
    if empty is not None and not row[column].strip():
        return empty
    try:
        value = float(row[column])
    except ValueError:
        value = math.nan
    if not abs(value) <= _LARGEST:
        raise UserError(
            f"{where}: {column}: {row[column]!r} is not allowed; a finite number, at most {_LARGEST:g} in size"
        )
    return value


def _whole(where: str, row: Mapping[str, Any], column: str) -> int:
    try:
        return int(row[column])
    except ValueError:
        raise UserError(f"{where}: {column}: {row[column]!r} is not allowed; a whole number") from None
