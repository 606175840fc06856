"""Recordings of KiwiSDR receivers with GPS time stamps, as recordings of samples."""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from quietfix.diagrams.readers.iq.recording import IqRecording, Segment
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.time_scales import posix_of, posix_to_tai
from quietfix.systems.iq.kiwi import common_base, read_kiwi
from quietfix.systems.iq.stamped import WEEK

__all__ = ["read_kiwi_file"]

_NAMED = re.compile(r"(?P<time>\d{8}T\d{6}Z)_(?P<frequency>\d+(?:\.\d+)?)_(?P<name>.+?)(?:_iq)?")
_GPS_BEGINS = 315_964_819  # 1980-01-06 in seconds of TAI since 1970: GPS time is 19 s behind TAI
_STEP = 250.0  # Hz: the sample rate is the next lower multiple


def read_kiwi_file(path: Path) -> IqRecording:
    """Read a recording; its samples are put on the second by its stamps.

    Its name ``TIME_FREQUENCY_NAME_iq.wav`` (TIME as 20200813T065220Z, FREQUENCY in Hz) says which week it is, to what
    the receiver was tuned and what it is called. Without that name nobody knows the date, and recordings of several
    receivers are compared by their seconds of the week all the same: of the week of 1980-01-06.

    Raises
    ------
    UserError
        As `quietfix.systems.iq.kiwi.read_kiwi`.
    """
    said = _NAMED.fullmatch(path.stem)
    try:
        file = read_kiwi(path)
        rate = max(_STEP * math.floor(file.sample_rate / _STEP), _STEP)
        frequency = float(said["frequency"]) if said else 0.0
        (blocks,), begin = common_base([file.parts], rate, frequency)
    except ValueError as error:
        raise UserError(f"FILE: {error}") from error
    week = _GPS_BEGINS
    notes = [*file.notes(), f"resampled to {rate:g} Hz by its GPS stamps"]
    if said:
        try:
            second = datetime.strptime(said["time"], "%Y%m%dT%H%M%SZ").replace(tzinfo=UTC).timestamp()
            since = posix_to_tai(int(second)) - _GPS_BEGINS
            week += int(WEEK) * round((since - begin) / WEEK)
        except ValueError as error:
            raise UserError(f"FILE: {path.name}: {said['time']} in its name is not allowed; {error}") from error
    else:
        notes.append("its name does not say when it is of: dates are of the week of 1980-01-06")
    whole = math.floor(begin)
    segments = tuple(
        Segment(block.samples[0].astype(np.complex64), frequency, float(block.start_time[0]), True) for block in blocks
    )
    name = said["name"] if said else path.stem
    return IqRecording(name, rate, segments, (posix_of(week + whole), begin - whole), 0, (), None, tuple(notes))
