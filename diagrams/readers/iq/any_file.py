"""Recordings of samples in a file of any kind that is known."""

from __future__ import annotations

import math
from pathlib import Path

from quietfix.diagrams.readers.iq.data_bytes import FileData
from quietfix.diagrams.readers.iq.recording import MOST_SAMPLES, IqRecording, Segment
from quietfix.diagrams.readers.iq.samples import sample_type, segments_of
from quietfix.diagrams.readers.iq.sigmf_file import read_sigmf
from quietfix.diagrams.readers.iq.wav import read_wav
from quietfix.diagrams.schema.errors import UserError, shown
from quietfix.systems.files import Unreadable

__all__ = ["read_iq", "read_raw"]

_WAVES = (".wav", ".rf64", ".wave")


def read_iq(path: Path, raw_rate: float = 0.0, raw_type: str = "", raw_frequency: float = 0.0) -> list[IqRecording]:
    """Read the recordings of a file: SigMF, WAV by its ending, or samples alone.

    Parameters
    ----------
    path : Path
    raw_rate : float
        Sample rate of a file that is none of these [Hz]; 0: nobody knows.
    raw_type : str
        Its samples, see `quietfix.diagrams.readers.iq.samples`.
    raw_frequency : float
        To which its receiver was tuned [Hz].

    Raises
    ------
    UserError
        In one line, naming the file.
    """
    if path.suffix.lower() in _WAVES:
        return [read_wav(path)]
    if not raw_rate or ".sigmf" in path.name:
        return read_sigmf(path)
    return [read_raw(path, raw_rate, raw_type, raw_frequency)]


def read_raw(path: Path, rate: float, kind: str, frequency: float) -> IqRecording:
    """Read a file of samples and nothing else; nobody knows when it begins."""
    try:
        type_ = sample_type(kind, endless=True)
    except ValueError as error:
        raise UserError(f"raw.type: {error}") from error
    if not (math.isfinite(rate) and rate > 0):
        raise UserError(f"raw.rate_hz: {rate:g} is not allowed; a finite number > 0")
    try:
        data = FileData(path)
        count, rest = divmod(data.size, type_.size)
        if rest or count < 2:
            raise UserError(
                f"FILE: {shown(path)}: {data.size} bytes are no whole number of samples of {kind}; cut off?"
            )
        if count > MOST_SAMPLES:
            raise UserError(f"FILE: {shown(path)}: {count} samples are not allowed; at most {MOST_SAMPLES}")
        raw = data.numbers(type_.dtype, 0, data.size // type_.dtype.itemsize)
    except Unreadable as error:
        raise UserError(f"FILE: {error}") from error
    samples = segments_of(raw, 1, type_.complex, type_.numbers)[0]
    own, tuned = (rate, frequency) if type_.complex else (0.5 * rate, frequency + 0.25 * rate)
    return IqRecording(path.stem, own, (Segment(samples, tuned, 0.0),), None)
