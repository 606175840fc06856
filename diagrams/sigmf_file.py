"""Recordings of I/Q samples in the Signal Metadata Format (SigMF, https://sigmf.org), read by the package sigmf."""

from __future__ import annotations

import json
import math
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from diagrams.errors import UserError
from diagrams.instants import instant

__all__ = ["IqRecording", "read_sigmf"]


@dataclass(frozen=True, eq=False)
class IqRecording:
    """What a file holds.

    Attributes
    ----------
    name : str
        Name of the file without its ending.
    samples : ndarray of complex64, shape (n,)
    sample_rate : float
        [Hz]
    frequency : float
        To which the receiver was tuned [Hz]; 0 where the file does not say.
    start : (int, float) or None
        UTC of the first sample: whole seconds since 1970, and the rest [s]; None where the file does not say.
    """

    name: str
    samples: NDArray[np.complex64]
    sample_rate: float
    frequency: float
    start: tuple[int, float] | None


def read_sigmf(path: Path | str) -> IqRecording:
    """Read a recording of one channel; of several captures the first one.

    Parameters
    ----------
    path : path
        ``.sigmf-meta``, ``.sigmf-data`` or an archive ``.sigmf``.

    Raises
    ------
    UserError
        Naming the file, what is wrong and what is allowed: missing or broken files, data that are cut off (no whole
        number of samples, fewer than captures or annotations say, or another checksum), real samples, several channels.
    """
    import sigmf
    from sigmf.error import SigMFError

    file = Path(path)
    try:
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            recording = sigmf.fromfile(str(file))
            if not isinstance(recording, sigmf.SigMFFile):
                raise UserError(f"FILE: {file} is a collection; name its recordings one by one")
            if recording.data_file is None and recording.sample_count == 0:
                raise UserError(f"FILE: {file}: its data are missing; a file beside it that ends in .sigmf-data")
            if said:
                raise UserError(f"FILE: {file}: its data are cut off or broken ({said[0].message})")
            return _content(file, recording)
    except UserError:
        raise
    except (OSError, SigMFError, ValueError, KeyError, TypeError, json.JSONDecodeError) as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split()) or type(error).__name__
        if "hash" in reason:
            raise UserError(f"FILE: {file}: its data are cut off or changed (core:sha512 is that of others)") from error
        raise UserError(f"FILE: {file} cannot be read as a SigMF recording ({reason})") from error


def _content(file: Path, recording: Any) -> IqRecording:
    info = recording.get_global_info()
    if not recording.is_complex_data or int(info.get("core:num_channels", 1)) != 1:
        raise UserError(
            f"FILE: {file}: core:datatype {info.get('core:datatype')} with {info.get('core:num_channels', 1)} "
            "channel(s) is not allowed; complex samples of one channel"
        )
    rate = _number(file, "core:sample_rate", info.get("core:sample_rate"))
    if not rate > 0:
        raise UserError(f"FILE: {file}: core:sample_rate {rate:g} is not allowed; a number > 0 Hz")
    count = int(recording.sample_count)
    captures = recording.get_captures() or [{}]
    begins = [int(capture.get("core:sample_start", 0)) for capture in captures]
    claimed = max(
        [
            *begins,
            *(int(a["core:sample_start"]) + int(a.get("core:sample_count", 0)) for a in recording.get_annotations()),
        ]
    )
    if claimed > count or count == 0:
        raise UserError(
            f"FILE: {file}: its data are cut off: {count} samples, where its metadata speak of {max(claimed, 1)}"
        )
    first, end = begins[0], begins[1] if len(begins) > 1 else count
    frequency = captures[0].get("core:frequency")
    stamp = captures[0].get("core:datetime")
    samples = np.asarray(recording.read_samples(first, end - first), dtype=np.complex64)
    return IqRecording(
        file.name.removesuffix(file.suffix) if file.suffix.startswith(".sigmf") else file.name,
        samples,
        rate,
        0.0 if frequency is None else _number(file, "core:frequency", frequency),
        None if stamp is None else _instant(file, str(stamp)),
    )


def _number(file: Path, key: str, value: Any) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise UserError(f"FILE: {file}: {key}: {value} is not allowed; a finite number")
    return number


def _instant(file: Path, text: str) -> tuple[int, float]:
    try:
        return instant(text)
    except ValueError as error:
        raise UserError(f"FILE: {file}: core:datetime: {error}") from error
