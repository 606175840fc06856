"""Recordings of KiwiSDR receivers: I/Q samples with GPS time stamps, on one base of time.

The files look like RIFF ``WAVE`` but hold about 690 pairs of a chunk ``kiwi`` (u8 seconds since the last GPS solution,
u8 unused, u32 GPS seconds of the week, u32 nanoseconds) and a chunk ``data`` of 512 pairs of 16-bit I and Q. A stamp
holds for the first sample of the ``data`` that follows. The first one to three are left over from before. Each receiver
has a sample rate of its own, a little above 12 kHz.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.files import read_bytes
from quietfix.systems.iq.block import IqBlock
from quietfix.systems.iq.resample import interpolate

__all__ = ["GpsRecording", "common_base", "read_kiwi"]

Array = NDArray[np.float64]

_STAMP = struct.Struct("<BBII")
_STEADY = 0.01  # of the time between two stamps; what a stale stamp is off by more than
_WORST = 5e-6  # s; what a clock that was set by GPS may leave
_WEEK = 604800.0


@dataclass(frozen=True, eq=False)
class GpsRecording:
    """Samples whose times are known.

    Attributes
    ----------
    samples : ndarray of complex, shape (n,)
        At the tuned frequency.
    start : float
        GPS second of the week of the first sample [s].
    sample_rate : float
        As the stamps say [Hz].
    stale : int
        Stamps that were left out at the beginning.
    scatter : float
        Root mean square of the stamps about a steady clock [s].
    """

    samples: NDArray[np.complex128]
    start: float
    sample_rate: float
    stale: int
    scatter: float

    @property
    def end(self) -> float:
        """GPS second of the week of the last sample [s]."""
        return self.start + (self.samples.size - 1) / self.sample_rate


def read_kiwi(file: Path) -> GpsRecording:
    """Read a recording.

    Parameters
    ----------
    file : Path
        See the module.

    Raises
    ------
    ValueError
        If it cannot be read, is not such a file, is cut off, or its stamps are not those of a steady clock; it names
        the file.
    """
    stamps, parts = _chunks(file, read_bytes(file))
    counts = np.array([part.size // 2 for part in parts])
    raw = np.concatenate(parts).astype(np.float64)
    first = np.concatenate([[0], np.cumsum(counts)[:-1]])
    stale = _stale(file, stamps, first)
    place, time = first[stale:].astype(float), stamps[stale:]
    middle, zero = place.mean(), time[0]
    slope, offset = np.polyfit(place - middle, time - zero, 1)
    left = time - zero - (offset + slope * (place - middle))
    if np.abs(left).max() > _WORST:
        raise ValueError(
            f"{file}: stamps: {1e6 * np.abs(left).max():.3g} us off a steady clock are not allowed; at most "
            f"{1e6 * _WORST:g} us"
        )
    start = float(zero + offset - slope * middle)
    return GpsRecording(raw[::2] + 1j * raw[1::2], start, float(1 / slope), stale, float(np.sqrt(np.mean(left**2))))


def _chunks(file: Path, data: bytes) -> tuple[Array, list[NDArray[np.int16]]]:
    if data[:4] != b"RIFF" or data[8:12] != b"WAVE":
        raise ValueError(
            f"{file}: it does not begin with RIFF and WAVE; a recording of a KiwiSDR with stamps is needed"
        )
    stamps: list[float] = []
    parts: list[NDArray[np.int16]] = []
    place, formatted = 12, False
    while place + 8 <= len(data):
        kind, size = data[place : place + 4], int.from_bytes(data[place + 4 : place + 8], "little")
        body = data[place + 8 : place + 8 + size]
        if len(body) < size:
            raise ValueError(f"{file}: it is cut off at byte {len(data)}, within a chunk of {size} bytes")
        if kind == b"fmt ":
            if size < 16 or struct.unpack_from("<HH", body) != (1, 2) or struct.unpack_from("<H", body, 14) != (16,):
                raise ValueError(f"{file}: its format is not allowed; two channels (I and Q) of 16 bit")
            formatted = True
        elif kind == b"kiwi" and size == _STAMP.size:
            _, _, seconds, nanoseconds = _STAMP.unpack(body)
            stamps.append(seconds + 1e-9 * nanoseconds)
        elif kind == b"data":
            parts.append(np.frombuffer(body[: size // 4 * 4], "<i2"))
        place += 8 + size + size % 2
    if not formatted or not stamps or len(stamps) != len(parts):
        raise ValueError(
            f"{file}: {len(stamps)} stamps (chunks `kiwi`) and {len(parts)} blocks (chunks `data`) are not allowed; "
            "as many of one as of the other, behind a chunk `fmt `"
        )
    return np.array(stamps), parts


def _stale(file: Path, stamps: Array, first: NDArray[np.int64]) -> int:
    """Return how many stamps at the beginning do not belong to the clock of the rest."""
    if stamps.size < 10:
        raise ValueError(f"{file}: {stamps.size} stamps are not allowed; at least 10")
    pace = np.diff(stamps) / np.diff(first)
    usual = np.median(pace)
    odd = np.flatnonzero(np.abs(pace - usual) > _STEADY * usual)
    if odd.size and odd[-1] + 1 > stamps.size // 2:
        raise ValueError(
            f"{file}: stamps: {stamps[odd[-1] + 1]:.3f} s after {stamps[odd[-1]]:.3f} s is not a steady clock"
        )
    return int(odd[-1]) + 1 if odd.size else 0


def common_base(
    recordings: Sequence[GpsRecording], sample_rate: float, frequency: float
) -> tuple[list[IqBlock], float]:
    """Return the recordings at the same instants, as far as all of them reach.

    Parameters
    ----------
    recordings : sequence of GpsRecording
        At least one.
    sample_rate : float
        Of the result [Hz].
    frequency : float
        To which the receivers were tuned [Hz].

    Returns
    -------
    list of IqBlock
        Of equal length, beginning at time 0.
    float
        GPS second of the week of that time [s].

    Raises
    ------
    ValueError
        If they have no time in common.
    """
    begin = np.ceil(max(one.start for one in recordings) * sample_rate) / sample_rate
    end = min(one.end for one in recordings)
    count = int(np.floor((end - begin) * sample_rate)) + 1
    if count < 1:
        raise ValueError(
            f"recordings: they have no time in common; the last begins at {begin:.3f} s, one ends at {end:.3f} s"
        )
    time = np.arange(count) / sample_rate
    blocks = []
    for one in recordings:
        place = (begin - one.start + time) * one.sample_rate
        blocks.append(IqBlock(interpolate(one.samples, place), sample_rate, frequency))
    return blocks, float(begin % _WEEK)
