"""What the captures of a SigMF recording say: which samples belong together, and when and where in frequency they are.

SigMF 1.2 says of ``core:offset`` that it is the index of the first sample in the data, and that "all sample indices in
SigMF are absolute, and so all other indices [...] SHOULD be greater than or equal to this value"; of
``core:sample_start`` also that it counts "relative to the recorded Dataset file". Both are read: indices are absolute
unless one lies below the offset, which no absolute one can.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from quietfix.systems.earth.time_scales import to_posix

__all__ = ["Capture", "Part", "captures_of", "finite", "parts_of", "place_of", "whole"]

_LARGEST = 1e15  # Hz
_HIGHEST = 1e8  # m


@dataclass(frozen=True)
class Capture:
    """A capture.

    Attributes
    ----------
    first, count : int
        Its samples in the file, from 0.
    index : int
        Of its first sample in the receiver's stream (``core:global_index``, otherwise ``core:sample_start``).
    frequency : float
        [Hz]; 0 where it is not said.
    stamp : (int, float) or None
        UTC, see `quietfix.systems.earth.time_scales.to_posix`.
    resolution : float
        Of the stamp: a unit of its last digit [s].
    header : int
        Bytes in the file before it that are no samples.
    place : tuple of float, or None
        Latitude, longitude [deg], height above the ellipsoid [m].
    """

    first: int
    count: int
    index: int
    frequency: float
    stamp: tuple[int, float] | None
    resolution: float
    header: int
    place: tuple[float, float, float] | None


@dataclass(frozen=True)
class Part:
    """Samples without a gap, at one frequency.

    Attributes
    ----------
    first, count : int
        In the file, from 0.
    frequency : float
        [Hz]
    begin : float
        Since the first sample of the recording [s].
    header : int
        Bytes in the file before it that are no samples.
    dated : bool
        Whether a date says when it begins, instead of the samples since the first one.
    """

    first: int
    count: int
    frequency: float
    begin: float
    header: int
    dated: bool


def captures_of(
    captures: Sequence[Mapping[str, Any]], annotations: Sequence[Mapping[str, Any]], offset: int, count: int
) -> list[Capture]:
    """Return the captures with their places in the file.

    Parameters
    ----------
    captures, annotations : sequence of mapping
        As in the metadata; without a capture there is one, from the beginning.
    offset : int
        ``core:offset``.
    count : int
        Samples in the file.

    Raises
    ------
    ValueError
        If the data are shorter than what is said of them, or a capture is not allowed; it names the field.
    """
    told = [whole("core:sample_start", one.get("core:sample_start", 0)) for one in (*captures, *annotations)]
    shift = offset if told and min(told) >= offset else 0
    starts = [one - shift for one in told[: len(captures)]] or [0]
    lengths = [whole("core:sample_count", one.get("core:sample_count", 0)) for one in annotations]
    ends = [one - shift + length for one, length in zip(told[len(captures) :], lengths, strict=True)]
    claimed = max([*starts, *ends])
    if claimed > count or count == 0:
        raise ValueError(f"its data are cut off: {count} samples, where its metadata speak of {max(claimed, 1)}")
    if any(later < one for one, later in itertools.pairwise(starts)):
        raise ValueError(f"core:sample_start {starts} is not allowed; captures in the order of their samples")
    found = []
    absolute = told[: len(captures)] or [0]
    header = 0
    for about, first, end, own in zip(captures or [{}], starts, [*starts[1:], count], absolute, strict=True):
        header += whole("core:header_bytes", about.get("core:header_bytes", 0))
        if end == first:
            continue
        stamp, frequency = about.get("core:datetime"), about.get("core:frequency", 0.0)
        try:
            when = None if stamp is None else to_posix(str(stamp))
        except ValueError as error:
            raise ValueError(f"core:datetime: {error}") from error
        digits = sum(map(str.isdigit, str(stamp).partition(".")[2].partition("+")[0].partition("-")[0]))
        index = whole("core:global_index", about.get("core:global_index", own))
        tuned = finite("core:frequency", frequency)
        if tuned < 0:
            raise ValueError(f"core:frequency: {tuned:g} is not allowed; >= 0 Hz")
        place = place_of(about.get("core:geolocation"))
        found.append(Capture(first, end - first, index, tuned, when, 10.0**-digits, header, place))
    if not found:
        raise ValueError("core:sample_start is not allowed; a capture that has samples")
    return found


def whole(key: str, value: Any) -> int:
    """Return a whole number >= 0 of the metadata; ValueError names its key otherwise."""
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"{key}: {value} is not allowed; a whole number >= 0")
    return value


def finite(key: str, value: Any) -> float:
    """Return a finite number of the metadata; ValueError names its key otherwise."""
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not abs(number) <= _LARGEST:
        raise ValueError(f"{key}: {value} is not allowed; a finite number, at most {_LARGEST:g} in size")
    return number


def place_of(value: Any) -> tuple[float, float, float] | None:
    """Return latitude, longitude [deg] and height [m] of a ``core:geolocation``, a GeoJSON point; None of None.

    Raises
    ------
    ValueError
        For what is no such point.
    """
    if value is None:
        return None
    wrong = ValueError(
        f"core:geolocation: {json.dumps(value)[:80]} is not allowed; a GeoJSON Point, its coordinates longitude and "
        "latitude [deg] and, as needed, height above the ellipsoid [m]"
    )
    if not isinstance(value, Mapping) or value.get("type") != "Point":
        raise wrong
    numbers = value.get("coordinates")
    if not isinstance(numbers, list) or len(numbers) not in (2, 3):
        raise wrong
    if not all(isinstance(one, int | float) and not isinstance(one, bool) for one in numbers):
        raise wrong
    longitude, latitude, height = *map(_bounded, numbers), *([0.0] if len(numbers) == 2 else [])
    if not (abs(longitude) <= 360 and abs(latitude) <= 90 and abs(height) <= _HIGHEST):
        raise wrong
    return latitude, longitude, height


def _bounded(value: float) -> float:
    """Return a number as a float; NaN where none is as large."""
    try:
        return float(value)
    except OverflowError:
        return math.nan


def parts_of(captures: Sequence[Capture], rate: float) -> tuple[list[Part], tuple[int, float] | None, list[float]]:
    """Return the parts without a gap, UTC of the first sample of all (None where no capture has a date), and begins.

    The last are the times at which the captures begin, since the first sample of all [s].

    A capture's own date says when it begins; without one, the samples since the capture before do. What follows
    without a gap, to half a sample or to the last digit of a date with a fraction, is counted in samples, which is
    exact: samples keep their distances, dates are rounded. A date that is earlier than the samples before allow is
    counted in samples too, if its last digit leaves that open.

    Raises
    ------
    ValueError
        If a capture begins before the one before has ended.
    """
    dated = next((one for one in captures if one.stamp is not None), None)
    parts: list[Part] = []
    begins: list[float] = []
    begin, counted = 0.0, True
    for i, one in enumerate(captures):
        if i:
            before = captures[i - 1]
            begin += (one.index - before.index) / rate
            if dated is not None and one.stamp is not None and one is not dated:
                told = _dated(one, begin, _since(one, dated, captures, rate), rate)
                begin, counted = told, counted and told == begin
            over = begin - (parts[-1].begin + parts[-1].count / rate)
            if over < -0.5 / rate:
                raise ValueError(
                    f"the capture at sample {one.first} begins {-over:.6g} s before the one before has ended; its "
                    "core:datetime or core:global_index is not allowed"
                )
            last = parts[-1]
            if over <= 0.5 / rate and (last.frequency, last.header) == (one.frequency, one.header):
                parts[-1] = replace(last, count=last.count + one.count)
                begin = last.begin + (one.first - last.first) / rate
                begins.append(begin)
                continue
        begins.append(begin)
        parts.append(Part(one.first, one.count, one.frequency, begin, one.header, not counted))
    if dated is None or dated.stamp is None:
        return parts, None, begins
    lead = (dated.index - captures[0].index) / rate
    seconds = math.floor(dated.stamp[1] - lead)
    return parts, (dated.stamp[0] + seconds, dated.stamp[1] - lead - seconds), begins


def _since(one: Capture, dated: Capture, captures: Sequence[Capture], rate: float) -> float:
    """Return how long after the first sample of all a capture begins by its date [s]."""
    assert one.stamp is not None and dated.stamp is not None
    lead = (dated.index - captures[0].index) / rate
    return (one.stamp[0] - dated.stamp[0]) + (one.stamp[1] - dated.stamp[1]) + lead


def _dated(one: Capture, counted: float, dated: float, rate: float) -> float:
    """Return when a capture begins: as its samples are counted where the date agrees, otherwise as the date says."""
    least = 0.5 / rate
    late = max(least, one.resolution) if one.resolution < 1 else least
    early = max(least, one.resolution)
    return counted if -early <= dated - counted <= late else dated
