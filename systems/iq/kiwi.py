"""Recordings of KiwiSDR receivers: I/Q samples with GPS time stamps, on one base of time.

The files look like RIFF ``WAVE`` but hold many pairs of a chunk ``kiwi`` (u8 seconds since the last GPS solution, 254
and 255: none, u8 unused, u32 GPS seconds of the week, u32 nanoseconds) and a chunk ``data`` of pairs of 16-bit I and Q.
A stamp holds for the first sample of the ``data`` that follows. The first one to three are left over from before. Each
receiver has a sample rate of its own, a little above 12 or 20.25 kHz.
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
from quietfix.systems.iq.stamped import WEEK, Clock, Dated, clocks

__all__ = ["GpsRecording", "KiwiFile", "common_base", "read_kiwi"]

Array = NDArray[np.float64]

_STAMP = struct.Struct("<BBII")
_NO_GPS = 254  # seconds since the last solution, from which on there is none
_FEWEST = 64  # samples of a part that is worth keeping
_ROUNDING = 1e-5  # samples


@dataclass(frozen=True, eq=False)
class GpsRecording:
    """Samples without a gap, whose times are known.

    Attributes
    ----------
    samples : ndarray of complex, shape (n,)
        At the tuned frequency.
    clock : Clock
        GPS second of the week of each of them.
    """

    samples: NDArray[np.complex128]
    clock: Clock

    @property
    def start(self) -> float:
        """GPS second of the week of the first sample [s]."""
        return float(self.clock.time(np.zeros(1))[0])

    @property
    def end(self) -> float:
        """GPS second of the week of the last sample [s]; it may be beyond the end of the week."""
        return float(self.clock.time(np.array([self.samples.size - 1.0]))[0])

    @property
    def sample_rate(self) -> float:
        """As the stamps say [Hz]."""
        return self.clock.sample_rate


@dataclass(frozen=True, eq=False)
class KiwiFile:
    """What a file holds.

    Attributes
    ----------
    parts : tuple of GpsRecording
        In the order of time; several where samples were lost on the way.
    stale : int
        Stamps at the beginning that belong to no clock; their blocks are left out.
    false : int
        Later stamps that are not those of the clock about them.
    lost : int
        Blocks left out later, for no clock says when they were.
    cut : bool
        Whether it ends within a chunk.
    scatter : float
        Root mean square of the stamps about their clock [s].
    """

    parts: tuple[GpsRecording, ...]
    stale: int
    false: int
    lost: int
    cut: bool
    scatter: float

    @property
    def sample_rate(self) -> float:
        """That of the longest part [Hz]."""
        return max(self.parts, key=lambda part: part.samples.size).sample_rate

    def notes(self) -> list[str]:
        """Return what is wrong with it, in words."""
        found = []
        if self.false:
            blocks = f", {self.lost} block(s) with them" if self.lost else "; the samples about them are whole"
            found.append(f"{self.false} time stamp(s) that are not those of a steady clock left out{blocks}")
        for one, other in zip(self.parts, self.parts[1:], strict=False):
            gap = other.start - one.end - 1 / one.sample_rate
            found.append(f"{gap:.3g} s of samples are missing at GPS second {one.end % WEEK:.3f}")
        if self.cut:
            found.append("it is cut off; the last block is left out")
        return found


def read_kiwi(file: Path) -> KiwiFile:
    """Read a recording.

    Parameters
    ----------
    file : Path
        See the module.

    Raises
    ------
    ValueError
        If it cannot be read, is not such a file, or its stamps are not those of a steady clock; it names the file.
    """
    stamps, parts, rate, cut = _chunks(file, read_bytes(file))
    counts = np.array([part.size // 2 for part in parts])
    raw = np.concatenate(parts).astype(np.float64)
    samples = raw[::2] + 1j * raw[1::2]
    first = np.concatenate([[0], np.cumsum(counts)])
    try:
        dated = clocks(stamps, first[:-1], rate)
    except ValueError as error:
        raise ValueError(f"{file}: stamps: {error}") from error
    found = [
        GpsRecording(samples[first[one.begin] : first[one.end]], one.clock.from_sample(int(first[one.begin])))
        for one in dated
        if first[one.end] - first[one.begin] >= _FEWEST
    ]
    if not found:
        raise ValueError(f"{file}: it has fewer than {_FEWEST} samples of known time")
    return KiwiFile(tuple(found), *_left_out(dated, stamps.size), cut, _scatter(dated))


def _left_out(dated: Sequence[Dated], stamps: int) -> tuple[int, int, int]:
    """Return stale stamps, false ones after them, and the blocks after them that belong to no part."""
    stale = dated[0].begin
    good = sum(one.residual.size for one in dated)
    lost = stamps - stale - sum(one.end - one.begin for one in dated)
    return stale, stamps - stale - good, lost


def _scatter(dated: Sequence[Dated]) -> float:
    return float(np.sqrt(np.mean(np.square(np.concatenate([one.residual for one in dated])))))


def _chunks(file: Path, data: bytes) -> tuple[Array, list[NDArray[np.int16]], float, bool]:
    """Return stamps, blocks, the sample rate that the file claims, and whether it ends within a chunk."""
    if data[:4] != b"RIFF" or data[8:12] != b"WAVE":
        raise ValueError(
            f"{file}: it does not begin with RIFF and WAVE; a recording of a KiwiSDR with stamps is needed"
        )
    stamps: list[float] = []
    ages: list[int] = []
    parts: list[NDArray[np.int16]] = []
    place, rate, cut = 12, 0.0, False
    stamp = 0.0  # of a block without one: no clock's
    while place + 8 <= len(data):
        kind, size = data[place : place + 4], int.from_bytes(data[place + 4 : place + 8], "little")
        body = data[place + 8 : place + 8 + size]
        if len(body) < size:
            cut = True
            break
        if kind == b"fmt ":
            if size < 16 or struct.unpack_from("<HH", body) != (1, 2) or struct.unpack_from("<H", body, 14) != (16,):
                raise ValueError(f"{file}: its format is not allowed; two channels (I and Q) of 16 bit")
            rate = float(struct.unpack_from("<I", body, 4)[0])
        elif kind == b"kiwi" and size == _STAMP.size:
            age, _, seconds, nanoseconds = _STAMP.unpack(body)
            stamp = seconds + 1e-9 * nanoseconds
            ages.append(age)
        elif kind == b"data":
            parts.append(np.frombuffer(body[: size // 4 * 4], "<i2"))
            stamps.append(stamp)
            stamp = 0.0
        place += 8 + size + size % 2
    if not rate or not ages or not parts:
        raise ValueError(
            f"{file}: {len(ages)} stamps (chunks `kiwi`) and {len(parts)} blocks (chunks `data`) are not allowed; "
            "as many of one as of the other, behind a chunk `fmt ` with a sample rate"
        )
    if min(ages) >= _NO_GPS:
        raise ValueError(f"{file}: its receiver had no GPS: no stamp says when its samples were taken")
    return np.array(stamps), parts, rate, cut or place < len(data)


def common_base(
    recordings: Sequence[Sequence[GpsRecording]], sample_rate: float, frequency: float
) -> tuple[list[list[IqBlock]], float]:
    """Return the recordings at the same instants, from where the first to where the last of them are all there.

    Parameters
    ----------
    recordings : sequence of sequence of GpsRecording
        The parts of each receiver, in the order of time; at least one receiver.
    sample_rate : float
        Of the result [Hz].
    frequency : float
        To which the receivers were tuned [Hz].

    Returns
    -------
    list of list of IqBlock
        The parts of each receiver; time 0 is when all are there for the first time.
    float
        GPS second of the week of that time [s].

    Raises
    ------
    ValueError
        If they have no time in common.
    """
    zero = recordings[0][0].start
    # another week, by the week's end: whatever is nearest
    weeks = [WEEK * round((parts[0].start - zero) / WEEK) for parts in recordings]
    starts = [parts[0].start - week for parts, week in zip(recordings, weeks, strict=True)]
    ends = [parts[-1].end - week for parts, week in zip(recordings, weeks, strict=True)]
    begin = float(np.ceil(max(starts) * sample_rate) / sample_rate)
    if min(ends) < begin:
        raise ValueError(
            f"recordings: they have no time in common; the last begins at {max(starts):.3f} s, one ends at "
            f"{min(ends):.3f} s (GPS second of the week)"
        )
    blocks = []
    for parts, week in zip(recordings, weeks, strict=True):
        found = [_on_base(part, begin + week, min(ends) + week, sample_rate, frequency) for part in parts]
        blocks.append([block for block in found if block is not None])
    if not all(blocks):
        raise ValueError("recordings: they have no time in common; where one is there, samples of another are missing")
    return blocks, begin % WEEK


def _on_base(part: GpsRecording, begin: float, end: float, sample_rate: float, frequency: float) -> IqBlock | None:
    """Return a part at instants that are whole samples from `begin` on; None: nothing of it is between the two."""
    # seconds of the week are told to 1e-10 s: what is that near to a sample is one
    first = max(0, int(np.ceil((part.start - begin) * sample_rate - _ROUNDING)))
    last = int(np.floor((min(part.end, end) - begin) * sample_rate + _ROUNDING))
    if last <= first:
        return None
    time = begin + np.arange(first, last + 1) / sample_rate
    return IqBlock(interpolate(part.samples, part.clock.place(time)), sample_rate, frequency, first / sample_rate)
