"""What a Tracking Data Message observed of a target, as a table of rows, and messages from such a table."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.ccsds.tdm import TrackingMessage, TrackingRecords, TrackingSegment
from quietfix.diagrams.schema.errors import UserError

__all__ = ["Link", "Observations", "message_of", "observations"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

_ANGLES = {
    "AZEL": ("azimuth", "elevation"),
    "RADEC": ("right_ascension", "declination"),
    "XEYN": ("x_east", "y_north"),
    "XSYE": ("x_south", "y_east"),
}
_SINGLE = {"RANGE": "range", "DOPPLER_INSTANTANEOUS": "range_rate", "DOPPLER_INTEGRATED": "mean_range_rate"}
_DIFFERENCED = {"RANGE": "range_difference", "DOR": "tdoa", "VLBI_DELAY": "tdoa", "RECEIVE_FREQ": "fdoa"}
_CORRECTED = {
    "RANGE": "CORRECTION_RANGE",
    "ANGLE_1": "CORRECTION_ANGLE_1",
    "ANGLE_2": "CORRECTION_ANGLE_2",
    "DOPPLER_INSTANTANEOUS": "CORRECTION_DOPPLER",
    "DOPPLER_INTEGRATED": "CORRECTION_DOPPLER",
    "RECEIVE_FREQ": "CORRECTION_RECEIVE",
}
_UNITS = {"range_rate": "km/s", "mean_range_rate": "km/s", "tdoa": "s", "fdoa": "Hz", "frequency": "Hz"}
_ABERRATION = ("CORRECTION_ABERRATION_YEARLY", "CORRECTION_ABERRATION_DIURNAL")
_MIDDLE = {"START": 0.5, "MIDDLE": 0.0, "END": -0.5}


class Link(NamedTuple):
    """What rows have in common.

    Attributes
    ----------
    kind : str
        range, range_rate, mean_range_rate (over the integration interval), frequency, azimuth, elevation,
        right_ascension, declination, x_east, y_north, x_south, y_east; of two paths tdoa, fdoa, range_difference:
        that by `path` less that by `other`.
    path : tuple of str
        Participants, the transmitter first, the receiver last. Two-way ranges and rates are of the whole way or of
        half of it, as the parties have agreed: the standard leaves that open.
    other : tuple of str
        The path that is subtracted; empty: none.
    unit : str
        km, km/s, Hz, deg, s, or RU, which only the parties know.
    frame : str
        Of right ascension and declination.
    modulus : float
        Ranges are known but for a multiple of it, in `unit`; 0: they are unambiguous.
    interval, middle : float
        Over which it was integrated, and from the time tag to the middle of that [s]; 0: not said.
    tagged : str
        Whether time tags are of TRANSMIT or RECEIVE; empty: of the end of the way that the datum belongs to.
    """

    kind: str
    path: tuple[str, ...]
    other: tuple[str, ...]
    unit: str
    frame: str = ""
    modulus: float = 0.0
    interval: float = 0.0
    middle: float = 0.0
    tagged: str = ""

    @property
    def receiver(self) -> str:
        """Where the signal ends."""
        return self.path[-1]

    @property
    def reference(self) -> str:
        """Where the other signal ends; empty: there is none."""
        return self.other[-1] if self.other else ""

    @property
    def transmitter(self) -> str:
        """Where the signal begins."""
        return self.path[0]


@dataclass(frozen=True, eq=False)
class Observations:
    """Rows in the order of time.

    Attributes
    ----------
    links : tuple of Link
    link : ndarray of int, shape (k,)
        Which each row is of.
    second : ndarray of int, shape (k,)
        Whole seconds of TAI since 1970; see `quietfix.systems.earth.time_scales`.
    rest : ndarray, shape (k,)
        And the rest [s].
    value : ndarray, shape (k,)
        In the unit of the link, with the frequency offset and with the corrections that the file has not applied.
    left_out : dict of str to int
        Keywords of the file that are no observations of a target (powers, weather, clocks ...), and how many of each.
    line : ndarray of int, shape (k,)
        Where each is in the file; 0: nowhere.
    """

    links: tuple[Link, ...]
    link: Integers
    second: Integers
    rest: Array
    value: Array
    left_out: Mapping[str, int]
    line: Integers


def observations(message: TrackingMessage) -> Observations:
    """Return the ranges, Doppler, frequencies, angles and differences of a message.

    FREQ_OFFSET is added to a received frequency (3.5.2.8), a correction where CORRECTIONS_APPLIED is NO (table 3-3).
    A difference is that by PATH_2 less that by PATH_1 (3.3.2.5.4).

    Raises
    ------
    UserError
        For an observation without a signal path, of right ascension without a frame, and for angles that want an
        aberration, which depends on the direction, to be added.
    """
    numbers: dict[Link, int] = {}
    left_out: Counter[str] = Counter()
    parts = [_rows(segment, numbers, left_out, n) for n, segment in enumerate(message.segments, 1)]
    link, second, rest, value, line = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.lexsort((link, rest, second))
    return Observations(
        tuple(numbers), link[order], second[order], rest[order], value[order], dict(left_out), line[order]
    )


def _rows(
    segment: TrackingSegment, numbers: dict[Link, int], left_out: Counter[str], number: int
) -> tuple[Integers, Integers, Array, Array, Integers]:
    records = segment.records
    keywords = np.array(records.keywords)
    link = np.full(keywords.size, -1, dtype=np.int64)
    value = records.value.copy()
    for name in dict.fromkeys(records.keywords):
        rows = keywords == name
        found = _link(segment, name, f"segment {number}: {name}")
        if found is None:
            left_out[name] += int(np.count_nonzero(rows))
            continue
        link[rows] = numbers.setdefault(found, len(numbers))
        value[rows] += _added(segment.metadata, name)
    kept = link >= 0
    line = records.line if records.line.size else np.zeros(link.size, dtype=np.int64)
    return link[kept], records.second[kept], records.rest[kept], value[kept], line[kept]


def _stem(name: str) -> str:
    return "RECEIVE_FREQ" if name.startswith("RECEIVE_FREQ_") else name


def _added(metadata: Mapping[str, str], name: str) -> float:
    """Return what is to be added to the values of a keyword."""
    stem, total = _stem(name), 0.0
    if metadata.get("CORRECTIONS_APPLIED") == "NO":
        total += _float(metadata, _CORRECTED.get(stem, ""))
    if stem == "RECEIVE_FREQ" and metadata.get("MODE") != "SINGLE_DIFF":
        total += _float(metadata, "FREQ_OFFSET")
    return total


def _float(metadata: Mapping[str, str], name: str) -> float:
    return float(metadata.get(name, "0").translate(str.maketrans("Dd", "Ee")))


def _link(segment: TrackingSegment, name: str, where: str) -> Link | None:
    """Return what the records of a keyword are; None: no observation of a target."""
    metadata, stem = segment.metadata, _stem(name)
    differenced = metadata.get("MODE") == "SINGLE_DIFF" or "PATH_2" in metadata
    frame = ""
    if stem in ("ANGLE_1", "ANGLE_2"):
        kind, frame = _angle(metadata, stem, where)
    elif differenced:
        kind = _DIFFERENCED.get(stem, "")
    else:
        kind = "frequency" if stem == "RECEIVE_FREQ" else _SINGLE.get(stem, "")
    if not kind:
        return None
    path = segment.participants("PATH_2" if differenced else "PATH")
    if not path:
        raise UserError(f"{where} has no receiver; MODE and PATH in the metadata")
    unit = metadata.get("RANGE_UNITS", "km") if stem == "RANGE" else _UNITS.get(kind, "deg")
    interval = _float(metadata, "INTEGRATION_INTERVAL") if kind in ("mean_range_rate", "frequency", "fdoa") else 0.0
    share = _MIDDLE.get(metadata.get("INTEGRATION_REF", ""), 0.0)
    return Link(
        kind,
        path,
        segment.participants("PATH_1") if differenced else (),
        unit,
        frame,
        _float(metadata, "RANGE_MODULUS") if stem == "RANGE" else 0.0,
        interval,
        interval * share if interval else 0.0,
        metadata.get("TIMETAG_REF", ""),
    )


def _angle(metadata: Mapping[str, str], stem: str, where: str) -> tuple[str, str]:
    """Return the kind of an angle and the frame that it is in."""
    type_ = metadata["ANGLE_TYPE"]
    frame = metadata.get("REFERENCE_FRAME", "")
    if type_ == "RADEC" and not frame:
        raise UserError(f"{where} needs a REFERENCE_FRAME in the metadata, such as EME2000 or TOD_EARTH")
    if metadata.get("CORRECTIONS_APPLIED") == "NO" and any(name in metadata for name in _ABERRATION):
        raise UserError(f"{where} without its aberration is not allowed; CORRECTIONS_APPLIED = YES")
    return _ANGLES[type_][stem == "ANGLE_2"], frame if type_ == "RADEC" else ""


_KEYWORDS = {
    "range": "RANGE",
    "range_difference": "RANGE",
    "range_rate": "DOPPLER_INSTANTANEOUS",
    "mean_range_rate": "DOPPLER_INTEGRATED",
    "frequency": "RECEIVE_FREQ",
    "fdoa": "RECEIVE_FREQ",
    "tdoa": "DOR",
    **{kind: f"ANGLE_{i}" for kinds in _ANGLES.values() for i, kind in enumerate(kinds, 1)},
}


def message_of(
    table: Observations, header: Mapping[str, str], time_system: str = "UTC", comments: Sequence[str] = ()
) -> TrackingMessage:
    """Return a message that says what a table says: a segment for each signal path and what belongs to it.

    Parameters
    ----------
    table : Observations
        `observations` of the message gives it again, but for what was left out.
    header : dict of str to str
        CREATION_DATE and ORIGINATOR, and MESSAGE_ID where there is one.
    time_system : {'UTC', 'TAI', 'GPS', 'TT'}
        Of the time tags.
    comments : sequence of str
        Of the header.

    Raises
    ------
    UserError
        For a kind or a unit that the standard does not have, and for more than five participants along a path.
    """
    groups: dict[tuple[tuple[str, str], ...], list[int]] = {}
    for i, link in enumerate(table.links):
        groups.setdefault(tuple(_metadata(link, time_system).items()), []).append(i)
    segments = []
    for metadata, links in groups.items():
        rows = np.flatnonzero(np.isin(table.link, links))
        if rows.size:
            names = tuple(_KEYWORDS[table.links[i].kind] for i in table.link[rows])
            records = TrackingRecords(names, table.second[rows], table.rest[rows], table.value[rows])
            segments.append(TrackingSegment(dict(metadata), records))
    if not segments:
        raise UserError("a message without observations is not allowed")
    return TrackingMessage(dict(header), tuple(segments), tuple(comments))


def _metadata(link: Link, time_system: str) -> dict[str, str]:
    """Return the metadata of rows of a link."""
    if link.kind not in _KEYWORDS:
        raise UserError(f"TDM: kind {link.kind} is not allowed; {', '.join(_KEYWORDS)}")
    names = list(dict.fromkeys((*link.path, *link.other)))
    if len(names) > 5:
        raise UserError(f"TDM: {len(names)} participants along a path are not allowed; at most 5")
    found = {"TIME_SYSTEM": time_system, **{f"PARTICIPANT_{n}": name for n, name in enumerate(names, 1)}}
    path = ",".join(str(names.index(name) + 1) for name in link.path)
    if link.other:
        other = ",".join(str(names.index(name) + 1) for name in link.other)
        found |= {"MODE": "SINGLE_DIFF", "PATH_1": other, "PATH_2": path}
    else:
        found |= {"MODE": "SEQUENTIAL", "PATH": path}
    if link.tagged:
        found["TIMETAG_REF"] = link.tagged
    if link.interval:
        share = link.middle / link.interval
        found["INTEGRATION_INTERVAL"] = repr(link.interval)
        found["INTEGRATION_REF"] = next(name for name, one in _MIDDLE.items() if abs(one - share) < 0.25)
    _check_unit(link)
    if link.modulus:
        found["RANGE_MODULUS"] = repr(link.modulus)
    if _KEYWORDS[link.kind] == "RANGE":
        found["RANGE_UNITS"] = link.unit
    for type_, kinds in _ANGLES.items():
        if link.kind in kinds:
            found["ANGLE_TYPE"] = type_
    if link.frame:
        found["REFERENCE_FRAME"] = link.frame
    return found


def _check_unit(link: Link) -> None:
    allowed = ("km", "s", "RU") if _KEYWORDS[link.kind] == "RANGE" else (_UNITS.get(link.kind, "deg"),)
    if link.unit not in allowed:
        raise UserError(f"TDM: unit {link.unit} of {link.kind} is not allowed; {', '.join(allowed)}")
