"""Paths from Orbit Ephemeris Messages."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path as FilePath

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.paths.movers import Oem
from quietfix.diagrams.paths.records import Setting, file_of, of_field, stamp_of
from quietfix.diagrams.readers.ccsds.oem import EphemerisMessage, EphemerisSegment, read_oem
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.celestial import equinox_to_earth_fixed, j2000_to_earth_fixed
from quietfix.systems.earth.frames import earth_fixed_to_inertial
from quietfix.systems.earth.time_scales import posix_of, to_tai
from quietfix.systems.plants.ephemeris import spline_samples
from quietfix.systems.plants.recorded import hermite

__all__ = ["oem_path"]

Array = NDArray[np.float64]
Path = Callable[[float], Array]
Moment = tuple[int, float]

_FIXED = re.compile(r"(ITRF|ITRS|ITR|DTRF|IGS|WGS)[-_ ]?[0-9A-Z]*|EFG|ECEF|GRC|GTOD|TDR|FIXED_EARTH")
_CELESTIAL = re.compile(r"(EME|J)2000|(GCRF|GCRS|ICRF|ICRS)[-_ ]?[0-9]*")
_EQUINOX = ("TEME", "TEMEOFDATE")
_AROUND = 12  # samples before and after a run that its ends are interpolated from
_TOUCHING = 1e-6  # s between two segments that follow each other


@dataclass(frozen=True, eq=False)
class _Piece:
    """A segment's spline, and from when to when it may be used [s since t = 0]."""

    begin: float
    end: float
    times: Array
    states: Array


@lru_cache(maxsize=32)
def _message(path: FilePath, stamp: tuple[int, int]) -> EphemerisMessage:
    """Read a file once for all diagrams of a run; `stamp` tells another version of it."""
    return read_oem(path)


def oem_path(field: Oem, setting: Setting, earth_rate: float, where: str) -> Path:
    """Return a satellite's inertial state as a function of time, in axes that are Earth-fixed at t = 0.

    Each sample is turned to Earth-fixed axes at its own time, and from there by the constant rate of the Earth. Within
    a segment it is interpolated by `quietfix.systems.plants.ephemeris.spline_samples`, never across two.

    Raises
    ------
    UserError
        If the file cannot be read, is about something that does not go around the Earth, is in axes that are not known
        here, or does not cover the run without a gap.
    """
    path = file_of(field.file, setting, where)
    with of_field(where):
        message = _message(path, stamp_of(path, where))
    what = f"{where}.file: {path.name}"
    zero = _zero(field, setting, message.segments[0])
    pieces = []
    for number, segment in enumerate(message.segments, 1):
        begin, end = (_since(one, zero) for one in _useable(segment))
        if end < 0 or begin > setting.duration:
            continue
        try:
            times, states = _samples(segment, zero, begin, end, setting.duration, earth_rate, field.ut1_minus_utc_s)
            pieces.append(_Piece(begin, end, *spline_samples(times, states)))
        except ValueError as error:
            raise UserError(f"{what}: segment {number}: {error}") from error
    _check_cover(pieces, _spans(message, zero), setting.duration, what)
    starts = np.array([piece.begin for piece in pieces])

    def at(t: float) -> Array:
        piece = pieces[max(int(np.searchsorted(starts, t, side="right")) - 1, 0)]
        return hermite(piece.times, piece.states, t)[0]

    return at


def _since(moment: Moment, zero: Moment) -> float:
    return moment[0] - zero[0] + (moment[1] - zero[1])


def _zero(field: Oem, setting: Setting, first: EphemerisSegment) -> Moment:
    """Return t = 0 in TAI."""
    began = setting.began()
    if field.start_s is not None:
        begin = _useable(first)[0]
        whole = int(np.floor(field.start_s))
        rest = begin[1] + (field.start_s - whole)
        return (begin[0] + whole + int(rest >= 1), rest - int(rest >= 1))
    return _useable(first)[0] if began is None else began


def _useable(segment: EphemerisSegment) -> tuple[Moment, Moment]:
    """Return from when to when a segment may be used: its samples, less what is for interpolation only."""
    found, scale = segment.metadata, segment.metadata["TIME_SYSTEM"]
    first, last = ((int(segment.second[i]), float(segment.rest[i])) for i in (0, -1))
    begin, end = (found.get(f"USEABLE_{name}_TIME") for name in ("START", "STOP"))
    return (
        max(first, to_tai(begin, scale)) if begin else first,
        min(last, to_tai(end, scale)) if end else last,
    )


def _samples(
    segment: EphemerisSegment,
    zero: Moment,
    begin: float,
    end: float,
    duration: float,
    earth_rate: float,
    ut1_minus_utc: float,
) -> tuple[Array, Array]:
    """Return times since t = 0 and inertial states [m, m/s] of the samples about a run."""
    times = (segment.second - zero[0]) + (segment.rest - zero[1])
    first = int(np.searchsorted(times, max(begin, 0.0), side="right")) - _AROUND
    last = int(np.searchsorted(times, min(end, duration), side="left")) + _AROUND
    kept = slice(max(first, 0), last)
    moments = segment.second[kept], segment.rest[kept]
    fixed = _earth_fixed(segment, 1e3 * segment.states[kept], *moments, zero, ut1_minus_utc)
    return times[kept], earth_fixed_to_inertial(fixed, times[kept], earth_rate)


def _earth_fixed(
    segment: EphemerisSegment,
    states: Array,
    second: NDArray[np.int64],
    rest: Array,
    zero: Moment,
    ut1_minus_utc: float,
) -> Array:
    """Return Earth-fixed states (k, 6) of states in the segment's axes.

    Raises
    ------
    ValueError
        For another centre and for axes that are not known here.
    """
    center, frame = (segment.metadata[name].upper() for name in ("CENTER_NAME", "REF_FRAME"))
    if center != "EARTH":
        raise ValueError(f"CENTER_NAME {center} is not allowed; EARTH")
    if _FIXED.fullmatch(frame):
        return states
    behind = posix_of(zero[0]) - zero[0]  # UTC less TAI at t = 0: UT1 has no leap seconds
    universal = second + behind, rest + ut1_minus_utc
    if _CELESTIAL.fullmatch(frame):
        return j2000_to_earth_fixed(states, second + rest, *universal)
    if frame in _EQUINOX:
        return equinox_to_earth_fixed(states, *universal)
    raise ValueError(
        f"REF_FRAME {frame} is not allowed; Earth-fixed (ITRF2000 or another, WGS84, EFG, GTOD, TDR), EME2000, J2000, "
        "GCRF, ICRF or TEME"
    )


def _spans(message: EphemerisMessage, zero: Moment) -> str:
    """Return from when to when there are segments."""
    spans = [[_since(one, zero) for one in _useable(segment)] for segment in message.segments]
    shown = [f"{begin:g} to {end:g}" for begin, end in spans]
    return ", ".join(shown if len(shown) < 5 else [*shown[:2], "...", shown[-1]])


def _check_cover(pieces: list[_Piece], spans: str, duration: float, what: str) -> None:
    """Refuse pieces that leave out part of a run."""
    reached = 0.0
    for piece in pieces:
        if piece.begin > reached + _TOUCHING:
            break
        inside = (piece.times >= max(piece.begin, 0.0)) & (piece.times <= min(piece.end, duration))
        for i in np.flatnonzero(inside & ~np.isfinite(piece.states).all(axis=-1)):
            raise UserError(
                f"{what} has a gap at {piece.times[i]:g} s of a run of {duration:g} s: its samples are too far apart"
            )
        reached = max(reached, piece.end)
    if not pieces or pieces[0].begin > _TOUCHING or reached < duration - _TOUCHING:
        raise UserError(f"{what}: a run from 0 to {duration:g} s is not allowed; it has {spans} s")
