"""Reader of LocaRDS messages: arrival times of ADS-B messages at receivers with GPS clocks.

``sensors.csv`` says where the receivers are; ``set_*.csv`` has one message a line: ``aircraft``, its own ``latitude``,
``longitude``, ``baroAltitude`` and ``geoAltitude``, and ``measurements``, a list of [receiver, time of arrival in ns,
signal strength]. The clocks' common zero is arbitrary. Recordings of others differ in words: columns in any order and
under their usual other names, any delimiter, numbers or texts as identifiers, and everything that an aircraft says of
itself may be missing.

Schaefer, Strohmeier, Leonardi and Lenders, *LocaRDS: a localization reference data set*, Sensors 21 (2021) 5516,
doi 10.3390/s21165516.
"""

from __future__ import annotations

import json
import math
import re
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.arrivals.cells import cell_rows, header_of, identifier, number, optional_number
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.geodetic import geodetic_to_ecef

__all__ = ["AircraftTrack", "LocardsSet", "Receiver", "holds_messages", "read_receivers", "read_set", "read_sets"]

Array = NDArray[np.float64]

_NS = 1e-9
_LATEST = 10**18  # ns; some 30 years
_DURATION = 120_000  # ns; what an aircraft sends takes so long, so two lines within it hold one message
_LATITUDE = ("latitude", "lat", "latitudedeg", "latdeg")
_LONGITUDE = ("longitude", "lon", "lng", "long", "longitudedeg", "londeg")
_RECEIVER_COLUMNS = {
    "serial": ("serial", "sensor", "receiver", "station", "sensorid", "receiverid", "stationid", "name", "id"),
    "latitude": _LATITUDE,
    "longitude": _LONGITUDE,
    "height": ("height", "heightm", "altitude", "altitudem", "alt", "altm", "elevation", "elevationm", "ele"),
}
_MESSAGE_COLUMNS = {
    "measurements": ("measurements", "arrivals", "receptions", "timesofarrival", "toas"),
    "aircraft": ("aircraft", "icao24", "icao", "icaoaddress", "target", "targetid", "aircraftid", "hex", "transponder"),
    "latitude": _LATITUDE,
    "longitude": _LONGITUDE,
    "baroAltitude": (
        *("baroaltitude", "baroalt", "altbaro", "barometricaltitude", "baroaltitudem", "pressurealtitude"),
        *("altitude", "altitudem", "alt"),
    ),
    "geoAltitude": ("geoaltitude", "geoalt", "altgeo", "geometricaltitude", "geoaltitudem", "gnssaltitude"),
}
_NEEDED = {"receivers": ("serial", "latitude", "longitude"), "messages": ("aircraft", "measurements")}
_FRACTION = re.compile(r"[+-]?\d+[.,]\d+")
_TABLES = ("*.csv", "*.tsv", "*.txt")


class Receiver(NamedTuple):
    """Where a receiver stands: Earth-fixed position [m], shape (3,), and height [m]."""

    position: Array
    height: float


@dataclass(frozen=True)
class AircraftTrack:
    """The messages of one aircraft, in the order of their arrival.

    Attributes
    ----------
    aircraft : int or str
        Number or name of the aircraft.
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

    aircraft: int | str
    times: Array
    arrivals: Array
    platforms: Array
    heights: Array
    altitude: Array
    reported: Array

    def part(self, which: slice) -> AircraftTrack:
        """Return some of the messages as a track."""
        arrays = {name: value[which] for name, value in vars(self).items() if name != "aircraft"}
        return AircraftTrack(self.aircraft, **arrays)


@dataclass(frozen=True)
class LocardsSet:
    """The tracks of one file.

    Attributes
    ----------
    name : str
        Name of the file, without its ending.
    tracks : list of AircraftTrack
        One per aircraft.
    repeats : int
        Lines left out because they hold a message that another line has already.
    notes : sequence of str
        What a reader of the results must know.
    """

    name: str
    tracks: list[AircraftTrack]
    repeats: int
    notes: Sequence[str] = ()


class _Message(NamedTuple):
    aircraft: int | str
    stamp: int  # ns
    receivers: list[int | str]
    arrivals: list[int]  # ns
    altitude: float
    reported: tuple[float, float, float]


def read_sets(folder: Path) -> list[LocardsSet]:
    """Read all sets of a folder.

    The receivers are in ``sensors.csv``, else in the one table that says where receivers are; the sets are
    ``set_*.csv``, else all tables with messages.

    Raises
    ------
    UserError
        If a file is missing or broken; it names file, line and what is allowed.
    """
    sensors = _sensors(folder)
    receivers = read_receivers(sensors)
    files = sorted(folder.glob("set_*.csv")) or _with_messages(folder)
    if not files:
        raise UserError(f"{folder}: there is no file set_*.csv")
    assumed = _without_height(sensors)
    return [read_set(file, receivers, sensors.name, assumed) for file in files]


def holds_messages(folder: Path) -> bool:
    """Return whether a folder has tables of messages, under whatever names."""
    return folder.is_dir() and bool(_with_messages(folder))


def _with_messages(folder: Path) -> list[Path]:
    return [file for file in _tables(folder) if header_of(file, _MESSAGE_COLUMNS) >= set(_NEEDED["messages"])]


def _tables(folder: Path) -> list[Path]:
    return sorted(file for pattern in _TABLES for file in folder.glob(pattern) if file.is_file())


def _sensors(folder: Path) -> Path:
    """Return the table of the receivers."""
    usual = folder / "sensors.csv"
    if usual.exists():
        return usual
    needed = set(_NEEDED["receivers"])
    found = [
        file
        for file in _tables(folder)
        if header_of(file, _RECEIVER_COLUMNS) >= needed and "measurements" not in header_of(file, _MESSAGE_COLUMNS)
    ]
    if len(found) > 1:
        names = ", ".join(file.name for file in found[:5])
        raise UserError(f"{folder}: {names} all say where receivers are; one of them, or sensors.csv")
    return found[0] if found else usual


def read_receivers(file: Path) -> dict[int | str, Receiver]:
    """Read where the receivers are; one at latitude 0, longitude 0 has no known place and is left out.

    One without a height stands as high as the others in the middle.
    """
    found: dict[int | str, tuple[float, float, float]] = {}
    for where, row in cell_rows(file, _RECEIVER_COLUMNS, _NEEDED["receivers"]):
        latitude, longitude = (number(where, row, column) for column in ("latitude", "longitude"))
        height = optional_number(where, row, "height")
        if not row["serial"]:
            raise UserError(f"{where}: serial: nothing is not allowed; a number or a name")
        if latitude == 0 and longitude == 0:
            continue
        if abs(latitude) > 90:
            raise UserError(f"{where}: latitude: {latitude:g} is not allowed; -90 to 90")
        found[identifier(row["serial"])] = latitude, longitude, height
    known = [height for _, _, height in found.values() if math.isfinite(height)]
    middle = float(np.median(known)) if known else 0.0
    receivers = {}
    for serial, (latitude, longitude, height) in found.items():
        level = height if math.isfinite(height) else middle
        receivers[serial] = Receiver(geodetic_to_ecef(math.radians(latitude), math.radians(longitude), level), level)
    return receivers


def _without_height(file: Path) -> set[int | str]:
    """Return the receivers whose height nobody says."""
    rows = cell_rows(file, _RECEIVER_COLUMNS, _NEEDED["receivers"])
    return {identifier(row["serial"]) for where, row in rows if math.isnan(optional_number(where, row, "height"))}


def read_set(
    file: Path,
    receivers: Mapping[int | str, Receiver],
    sensors: str = "sensors.csv",
    assumed: Collection[int | str] = (),
) -> LocardsSet:
    """Read the messages of a set.

    Parameters
    ----------
    file : Path
        ``set_*.csv``.
    receivers : mapping of int or str to Receiver
        What `read_receivers` returned.
    sensors : str
        Name of their file.
    assumed : collection of int or str
        Those whose height is assumed.
    """
    messages: list[_Message] = []
    for where, row in cell_rows(file, _MESSAGE_COLUMNS, _NEEDED["messages"]):
        messages.append(_message(where, row, receivers, sensors))
    if not messages:
        raise UserError(f"{file}: there are no messages in it")
    width = max(len(message.receivers) for message in messages)
    first = min(message.stamp for message in messages)
    aircraft: dict[int | str, list[_Message]] = defaultdict(list)
    repeats = 0
    for message in sorted(messages, key=lambda message: message.stamp):
        group = aircraft[message.aircraft]
        if group and message.stamp - group[-1].stamp < _DURATION:
            repeats += 1
        else:
            group.append(message)
    order = sorted(aircraft, key=lambda one: (isinstance(one, str), 0 if isinstance(one, str) else one, str(one)))
    tracks = [_track(aircraft[one], receivers, width, first) for one in order]
    heard = {serial for message in messages for serial in message.receivers}
    return LocardsSet(file.stem, tracks, repeats, _notes(sorted(map(str, heard & set(assumed))), sensors))


def _notes(levels: Sequence[str], sensors: str) -> list[str]:
    if not levels:
        return []
    more = f" and {len(levels) - 5} more" * (len(levels) > 5)
    return [f"{sensors} says no height of {', '.join(levels[:5])}{more}: taken for that of the others in the middle"]


def _track(messages: list[_Message], receivers: Mapping[int | str, Receiver], width: int, first: int) -> AircraftTrack:
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
    return AircraftTrack(
        messages[0].aircraft,
        np.array([(message.stamp - first) * _NS for message in messages]),
        arrivals,
        platforms,
        heights,
        np.array([message.altitude for message in messages]),
        np.array([message.reported for message in messages]),
    )


def _message(where: str, row: Mapping[str, str], receivers: Mapping[int | str, Receiver], sensors: str) -> _Message:
    serials, arrivals = _arrivals(where, row["measurements"], receivers, sensors)
    if not row["aircraft"] or _FRACTION.fullmatch(row["aircraft"]):
        raise UserError(f"{where}: aircraft: {row['aircraft'][:60]!r} is not allowed; a whole number or a name")
    degrees = [optional_number(where, row, column) for column in ("latitude", "longitude")]
    barometric, geometric = (optional_number(where, row, c) for c in ("baroAltitude", "geoAltitude"))
    return _Message(
        identifier(row["aircraft"]),
        # the middle one: a receiver whose clock is wrong must not move the message in time
        sorted(arrivals)[len(arrivals) // 2],
        serials,
        arrivals,
        barometric,
        (math.radians(degrees[0]), math.radians(degrees[1]), geometric),
    )


def _arrivals(
    where: str, cell: str, receivers: Mapping[int | str, Receiver], sensors: str
) -> tuple[list[int | str], list[int]]:
    """Return the receivers of a message, and when they heard it [ns]."""
    try:
        entries = json.loads(cell)
    except (ValueError, RecursionError) as error:
        raise UserError(f"{where}: measurements: {cell!r} is not a list ({error})") from error
    serials, arrivals = [], []
    for entry in entries if isinstance(entries, list) else [entries]:
        named = isinstance(entry, list) and len(entry) >= 2 and type(entry[0]) in (int, str)
        if not named or type(entry[1]) is not int or abs(entry[1]) >= _LATEST:
            raise UserError(f"{where}: measurements: {entry!r} is not allowed; [receiver, arrival in ns, strength]")
        serial = identifier(entry[0])
        if serial not in receivers:
            raise UserError(f"{where}: measurements: receiver {serial} has no place in {sensors}")
        serials.append(serial)
        arrivals.append(entry[1])
    if len(arrivals) < 2 or len(set(serials)) < len(serials):
        raise UserError(f"{where}: measurements: at least two different receivers are needed, there are {serials}")
    return serials, arrivals
