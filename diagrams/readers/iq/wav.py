"""I/Q in WAV files (RIFF, RF64): whole numbers of 8 to 32 bit, floats; the chunk ``auxi`` of SDR programs.

Two channels are I and Q, 2k of them k receivers that were sampled together; one is real samples. Formats: *Multimedia
Programming Interface and Data Specifications 1.0* (IBM, Microsoft, 1991), EBU Tech 3306 (RF64), and SpectraVue's user
guide (``auxi``: two times of 16 bytes, then centre frequency [Hz] and others as unsigned 32-bit numbers).
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.iq.data_bytes import FileData
from quietfix.diagrams.readers.iq.kiwi import read_kiwi_file
from quietfix.diagrams.readers.iq.recording import MOST_SAMPLES, IqRecording, Segment
from quietfix.diagrams.readers.iq.samples import segments_of
from quietfix.diagrams.schema.errors import UserError, shown
from quietfix.systems.files import Unreadable

__all__ = ["read_wav"]

_PCM, _FLOAT, _EXTENSIBLE = 1, 3, 0xFFFE
_WIDTHS = {_PCM: (8, 16, 24, 32), _FLOAT: (32, 64)}
_MOST_CHUNKS = 10_000
_LARGEST_CHUNK = 1 << 20  # bytes, of those that are no samples
_UNKNOWN = 0xFFFFFFFF
_LEAST_RATE, _MOST_CHANNELS = 1, 128
_CENTRE, _SECONDS = re.compile(r'RadioCenterFreq="(\d{1,12})"'), re.compile(r'UTCSeconds="(\d{1,11})"')


@dataclass(frozen=True)
class _Format:
    """How samples are written."""

    kind: int
    channels: int
    rate: int
    bits: int

    @property
    def complex(self) -> bool:
        return self.channels > 1

    @property
    def frame(self) -> int:
        return self.channels * self.bits // 8

    @property
    def dtype(self) -> np.dtype[np.generic]:
        if self.kind == _FLOAT:
            return np.dtype(f"<f{self.bits // 8}")
        return np.dtype({8: "u1", 16: "<i2", 24: "u1", 32: "<i4"}[self.bits])


@dataclass(frozen=True)
class _About:
    """What the chunk ``auxi`` says; 0 and None: nothing."""

    frequency: float = 0.0
    start: tuple[int, float] | None = None
    resolution: float = 1e-3
    note: str = ""


class _Stamped(Exception):
    """Its samples are in pieces with GPS stamps."""


def read_wav(path: Path) -> IqRecording:
    """Read a recording; one of a KiwiSDR, with GPS stamps, by these.

    Raises
    ------
    UserError
        In one line, naming the file and the field: what is no such file, is cut off, or in a format that is not known.
    """
    try:
        data = FileData(path)
        layout, about, first, size, notes = _chunks(data)
        samples = _samples(data, layout, first, size)
    except _Stamped:
        return read_kiwi_file(path)
    except Unreadable as error:
        raise UserError(f"FILE: {error}") from error
    except ValueError as error:
        raise UserError(f"FILE: {shown(path)}: {error}") from error
    rate = float(layout.rate)
    own, tuned = (rate, about.frequency) if layout.complex else (0.5 * rate, about.frequency + 0.25 * rate)
    channels = tuple((Segment(one, tuned, 0.0),) for one in samples)
    if about.start is not None:
        notes.append(
            f"its beginning (auxi) has digits down to {about.resolution:g} s, {about.resolution * rate:.3g} samples: "
            "time differences are no better"
        )
    notes += [about.note] if about.note else []
    return IqRecording(path.stem, own, channels[0], about.start, 0, channels[1:], None, tuple(notes))


def _chunks(data: FileData) -> tuple[_Format, _About, int, int, list[str]]:
    """Return format, what is said beside, and where the samples are."""
    head = _bytes(data, 0, 12)
    if len(head) < 12 or head[:4] not in (b"RIFF", b"RF64", b"BW64") or head[8:] != b"WAVE":
        raise ValueError("it does not begin with RIFF (or RF64) and WAVE; a WAV file is needed")
    layout: _Format | None = None
    about, long, at = _About(), None, 12
    notes: list[str] = []
    for _ in range(_MOST_CHUNKS):
        begin = _bytes(data, at, 8)
        if len(begin) < 8:
            raise ValueError(f"it is cut off at byte {data.size}, before the chunk `data`")
        kind, size = begin[:4], int.from_bytes(begin[4:], "little")
        if kind == b"data":
            if layout is None:
                raise ValueError("chunk `fmt `: it is missing before the chunk `data`")
            return layout, about, at + 8, _data_size(data, at + 8, size, long, layout, notes), notes
        if at + 8 + size > data.size:
            raise ValueError(f"it is cut off at byte {data.size}, within the chunk {kind!r} of {size} bytes")
        body = _bytes(data, at + 8, min(size, _LARGEST_CHUNK))
        if kind == b"fmt ":
            layout = _format(body)
        elif kind == b"ds64" and len(body) >= 16:
            long = int.from_bytes(body[8:16], "little")
        elif kind == b"auxi":
            about = _auxi(body)
        elif kind == b"kiwi":
            raise _Stamped
        at += 8 + size + size % 2
    raise ValueError(f"more than {_MOST_CHUNKS} chunks are not allowed")


def _bytes(data: FileData, first: int, count: int) -> bytes:
    """Return bytes, fewer at the end of the file."""
    count = max(min(count, data.size - first), 0)
    return data.numbers(np.dtype("u1"), first, count).tobytes() if count else b""


def _format(body: bytes) -> _Format:
    if len(body) < 16:
        raise ValueError(f"chunk `fmt `: {len(body)} bytes are not allowed; at least 16")
    kind, channels, rate, _, frame, bits = struct.unpack_from("<HHIIHH", body)
    if kind == _EXTENSIBLE and len(body) >= 26:
        kind = int.from_bytes(body[24:26], "little")  # of the GUID that says what it is
    if kind not in _WIDTHS:
        raise ValueError(f"chunk `fmt `: format {kind:#x} is not allowed; 1 (whole numbers) or 3 (floats)")
    if bits not in _WIDTHS[kind]:
        allowed = ", ".join(map(str, _WIDTHS[kind]))
        raise ValueError(f"chunk `fmt `: {bits} bits are not allowed for format {kind}; {allowed}")
    if channels not in (1, *range(2, _MOST_CHANNELS + 1, 2)):
        raise ValueError(f"chunk `fmt `: {channels} channels are not allowed; 1 (real), 2 (I and Q) or more such pairs")
    if rate < _LEAST_RATE:
        raise ValueError(f"chunk `fmt `: a sample rate of {rate} Hz is not allowed; > 0")
    found = _Format(kind, channels, rate, bits)
    if frame != found.frame:
        raise ValueError(f"chunk `fmt `: frames of {frame} bytes are not allowed; {found.frame}")
    return found


def _data_size(data: FileData, first: int, size: int, long: int | None, layout: _Format, notes: list[str]) -> int:
    """Return how many bytes of samples there are."""
    there = data.size - first
    if size == _UNKNOWN and long is not None:
        size = long
    elif size in (0, _UNKNOWN):  # a program that did not come to write it, or a file of more than 4 GB
        notes.append(
            f"its header does not say how many samples it has; {there // layout.frame}, to the end of the file"
        )
        size = there - there % layout.frame
    if size > there or size % layout.frame:
        raise ValueError(f"it is cut off at byte {data.size}: {there} bytes of samples, where the header says {size}")
    count = size // layout.frame
    most = MOST_SAMPLES // max(layout.channels // 2, 1)
    if count < 2 or count > most:
        raise ValueError(f"{count} samples are not allowed; 2 to {most}")
    return size


def _samples(data: FileData, layout: _Format, first: int, size: int) -> list[NDArray[np.complex64]]:
    raw = data.numbers(layout.dtype, first, size // layout.dtype.itemsize)
    convert: Callable[[NDArray[np.generic]], NDArray[np.float32]] = _floats(layout)
    if layout.bits == 24:
        raw = _of_24_bit(raw)
    return segments_of(raw, max(layout.channels // 2, 1), layout.complex, convert)


def _of_24_bit(raw: NDArray[np.generic]) -> NDArray[np.generic]:
    """Return 32-bit numbers, the third byte and its sign highest, of three bytes each."""
    wide = np.zeros((raw.size // 3, 4), np.uint8)
    wide[:, 1:] = raw.reshape(-1, 3)
    return wide.view("<i4").reshape(-1)


def _floats(layout: _Format) -> Callable[[NDArray[np.generic]], NDArray[np.float32]]:
    if layout.kind == _FLOAT:
        return lambda raw: raw.astype(np.float32)
    half, middle = (2.0**7, 2.0**7) if layout.bits == 8 else (2.0 ** (15 if layout.bits == 16 else 31), 0.0)
    return lambda raw: ((raw.astype(np.float64) - middle) / half).astype(np.float32)


def _auxi(body: bytes) -> _About:
    """Return when it begins and to what it was tuned; the chunk is binary, or XML in UTF-16 (SDR Console)."""
    for encoding in ("utf-16-le", "utf-8"):
        text = body.decode(encoding, errors="ignore")
        if "<" in text[:4] and (centre := _CENTRE.search(text)):
            seconds = _SECONDS.search(text)
            start = (int(seconds[1]), 0.0) if seconds and int(seconds[1]) else None
            return _About(float(centre[1]), start, 1.0)
    if len(body) < 36:
        return _About(note=f"its chunk auxi of {len(body)} bytes is not understood: it is taken to have no date")
    year, month, _, day, hour, minute, second, milli = struct.unpack_from("<8H", body)
    frequency = float(int.from_bytes(body[32:36], "little"))
    try:
        moment = datetime(year, month, day, hour, minute, second, tzinfo=UTC)
        if year < 1972 or milli > 999:
            raise ValueError
    except ValueError:
        return _About(frequency, note="the time in its chunk auxi is none: it is taken to have no date")
    return _About(frequency, (int(moment.timestamp()), 1e-3 * milli))
