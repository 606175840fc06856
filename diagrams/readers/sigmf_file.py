"""Recordings of I/Q samples in the Signal Metadata Format (SigMF, https://sigmf.org), read by the package sigmf."""

from __future__ import annotations

import io
import json
import tarfile
import warnings
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.sigmf_captures import captures_of, finite, parts_of, whole
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.files import Unreadable, regular_size

__all__ = ["IqRecording", "Segment", "read_sigmf"]

_META, _DATA = ".sigmf-meta", ".sigmf-data"
_ARCHIVES = (".sigmf", ".sigmf.gz", ".sigmf.xz", ".sigmf.zip")
_LARGEST_META, _LARGEST_ARCHIVE = 16_000_000, 200_000_000  # bytes
_LEAST_RATE = 1e-3  # Hz
_COUNTED_HERE = "Data source ends before the final annotation"  # what `captures_of` looks at with the offset in mind


@dataclass(frozen=True, eq=False)
class Segment:
    """Samples without a gap.

    Attributes
    ----------
    samples : ndarray of complex64, shape (n,)
    frequency : float
        To which the receiver was tuned [Hz]; 0 where the file does not say.
    begin : float
        Since the first sample of the recording [s].
    """

    samples: NDArray[np.complex64]
    frequency: float
    begin: float


@dataclass(frozen=True, eq=False)
class IqRecording:
    """What a file holds.

    Attributes
    ----------
    name : str
        Name of the recording without its ending.
    sample_rate : float
        [Hz]
    segments : tuple of Segment
        One or more; captures that follow each other without a gap at one frequency are one segment.
    start : (int, float) or None
        UTC of the first sample: whole seconds since 1970, and the rest [s]; None where the file does not say.
    unclaimed : int
        Samples before the first capture, which says nothing of them: they are left out.
    """

    name: str
    sample_rate: float
    segments: tuple[Segment, ...]
    start: tuple[int, float] | None
    unclaimed: int = 0


def read_sigmf(path: Path | str) -> list[IqRecording]:
    """Read a recording of one channel, or all those of an archive, with all of their captures.

    Parameters
    ----------
    path : path
        ``.sigmf-meta``, ``.sigmf-data`` or an archive ``.sigmf`` (also ``.gz``, ``.xz``, ``.zip``).

    Returns
    -------
    list of IqRecording
        Of an archive in the order of their names.

    Raises
    ------
    UserError
        Naming the file, what is wrong and what is allowed: missing or broken files, data that are cut off (no whole
        number of samples, fewer than captures or annotations say, or another checksum), real samples, several channels.
    """
    import sigmf

    file = Path(path)
    try:
        _check_files(file)
        archive = _archive(file)
        if archive is not None:
            return _unpacked(archive)
        _check_metadata(file)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            recording = sigmf.fromfile(str(file))
        if not isinstance(recording, sigmf.SigMFFile):
            raise UserError(f"FILE: {file} is a collection; name its recordings one by one")
        name = file.name.removesuffix(file.suffix) if file.suffix.startswith(".sigmf") else file.name
        return [_content(str(file), name, recording, said)]
    except UserError:
        raise
    except Unreadable as error:
        raise UserError(f"FILE: {error}") from error
    except Exception as error:  # two dozen kinds of the package, of archives, and of metadata that nobody expected
        reason = getattr(error, "strerror", None) or " ".join(str(error).split()) or type(error).__name__
        if "hash" in reason:
            raise UserError(f"FILE: {file}: its data are cut off or changed (core:sha512 is that of others)") from error
        raise UserError(f"FILE: {file} cannot be read as a SigMF recording ({reason})") from error


def _check_files(file: Path) -> None:
    """Raise `Unreadable` for what is no regular file, or where metadata or archive are too large."""
    from sigmf.sigmffile import get_sigmf_filenames

    names = {str(part): Path(path) for part, path in get_sigmf_filenames(file).items()}
    regular = [one for one in (file, names["meta_fn"], names["data_fn"], names["archive_fn"]) if one.exists()]
    for one in regular:
        size = regular_size(one)
        most = _LARGEST_META if one.name.endswith(_META) else _LARGEST_ARCHIVE
        if size > most and not one.name.endswith(_DATA):  # data are read where they are needed
            raise Unreadable(one, f"{size} bytes; at most {most} are allowed")


def _check_metadata(file: Path) -> None:
    """Raise a `UserError` that names the field, for metadata of a shape that the package stumbles over."""
    from sigmf.sigmffile import get_sigmf_filenames

    path = Path(get_sigmf_filenames(file)["meta_fn"])
    try:
        metadata = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):  # the package says what is wrong with it
        return
    if not isinstance(metadata, dict) or not isinstance(metadata.get("global", {}), dict):
        raise UserError(f"FILE: {path}: global is not allowed as it is; an object with core:datatype and others")
    for part in ("captures", "annotations"):
        entries = metadata.get(part, [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise UserError(f"FILE: {path}: {part}: {json.dumps(entries)[:60]} is not allowed; a list of objects")
    channels = metadata.get("global", {}).get("core:num_channels", 1)
    if channels != 1:
        raise UserError(f"FILE: {path}: core:num_channels: {json.dumps(channels)[:60]} is not allowed; 1")


def _check_members(archive: Path, sizes: Sequence[int]) -> None:
    if sum(sizes) > _LARGEST_ARCHIVE:
        raise Unreadable(archive, f"{sum(sizes)} bytes unpacked; at most {_LARGEST_ARCHIVE} are allowed")


def _archive(file: Path) -> Path | None:
    """Return the archive that is meant, None where a recording of its own is."""
    from sigmf.sigmffile import get_sigmf_filenames

    if file.name.lower().endswith(_ARCHIVES) and file.is_file():
        return file
    names = get_sigmf_filenames(file)
    archive = Path(names["archive_fn"])
    return archive if not Path(names["meta_fn"]).is_file() and archive.is_file() else None


def _members(archive: Path) -> dict[str, bytes]:
    """Return the files in an archive by their names."""
    if zipfile.is_zipfile(archive):
        with zipfile.ZipFile(archive) as packed:
            _check_members(archive, [one.file_size for one in packed.infolist()])
            return {name: packed.read(name) for name in packed.namelist() if not name.endswith("/")}
    found = {}
    with tarfile.open(archive) as tar:
        _check_members(archive, [member.size for member in tar.getmembers()])
        for member in tar.getmembers():
            stream = tar.extractfile(member) if member.isfile() else None
            if stream is not None:
                found[member.name] = stream.read()
    return found


def _unpacked(archive: Path) -> list[IqRecording]:
    """Return all recordings of an archive; the package reads but one of them."""
    import sigmf

    members = _members(archive)
    metas = sorted(name for name in members if name.endswith(_META))
    if not metas:
        raise UserError(f"FILE: {archive} holds no recording; a file that ends in {_META} is needed")
    recordings, used = [], set()
    for meta in metas:
        path = PurePosixPath(meta)
        where = f"{archive}, {path.name}"
        recording = sigmf.SigMFFile(metadata=members[meta])
        recording.validate()
        own = recording.get_global_info().get("core:dataset")
        data = str(path.with_name(own) if own else path.with_suffix(_DATA))
        if data not in members:
            raise UserError(f"FILE: {where}: its data are missing; {PurePosixPath(data).name} beside it")
        used.add(data)
        captures = recording.get_captures()
        header = int(captures[0].get("core:header_bytes", 0)) if captures else 0
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            recording.set_data_file(data_buffer=io.BytesIO(members[data]), offset=header)
        recordings.append(_content(where, path.name.removesuffix(_META), recording, said))
    lonely = sorted(name for name in members if name.endswith(_DATA) and name not in used)
    if lonely:
        raise UserError(f"FILE: {archive}: {lonely[0]} has no file beside it that ends in {_META}")
    return recordings


def _content(where: str, name: str, recording: Any, said: Sequence[warnings.WarningMessage]) -> IqRecording:
    """Return a recording; `where` is what an error calls it, `said` what the package warned of."""
    if recording.data_file is None and recording.data_buffer is None:
        raise UserError(f"FILE: {where}: its data are missing; a file beside it that ends in {_DATA}")
    told = [str(one.message) for one in said if not str(one.message).startswith(_COUNTED_HERE)]
    if told:
        raise UserError(f"FILE: {where}: its data are cut off or broken ({told[0]})")
    info = recording.get_global_info()
    if not recording.is_complex_data or int(info.get("core:num_channels", 1)) != 1:
        raise UserError(
            f"FILE: {where}: core:datatype {info.get('core:datatype')} with {info.get('core:num_channels', 1)} "
            "channel(s) is not allowed; complex samples of one channel"
        )
    try:
        rate = finite("core:sample_rate", info.get("core:sample_rate"))
        if not rate >= _LEAST_RATE:
            raise ValueError(f"core:sample_rate {rate:g} is not allowed; a number >= {_LEAST_RATE:g} Hz")
        captures = captures_of(
            recording.get_captures(),
            recording.get_annotations(),
            whole("core:offset", info.get("core:offset", 0)),
            int(recording.sample_count),
        )
        parts, start = parts_of(captures, rate)
    except ValueError as error:
        raise UserError(f"FILE: {where}: {error}") from error
    segments = tuple(
        Segment(
            np.asarray(recording.read_samples(part.first, part.count), dtype=np.complex64), part.frequency, part.begin
        )
        for part in parts
    )
    return IqRecording(name, rate, segments, start, parts[0].first)
