"""Recordings in the Signal Metadata Format (SigMF 1.2, https://sigmf.org): files, archives and collections."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from quietfix.diagrams.readers.iq.data_bytes import BytesData, Data, FileData
from quietfix.diagrams.readers.iq.recording import MOST_SAMPLES, IqRecording, Segment
from quietfix.diagrams.readers.iq.samples import SampleType, sample_type, segments_of
from quietfix.diagrams.readers.iq.sigmf_archive import members_of
from quietfix.diagrams.readers.iq.sigmf_captures import Capture, Part, captures_of, finite, parts_of, place_of, whole
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.files import Unreadable, read_bytes

__all__ = ["read_sigmf"]

_META, _DATA, _COLLECTION = ".sigmf-meta", ".sigmf-data", ".sigmf-collection"
_ARCHIVES = (".sigmf", ".sigmf.gz", ".sigmf.xz", ".sigmf.zip")
_LARGEST_META = 16_000_000  # bytes
_LEAST_RATE = 1e-3  # Hz
_MOST_CHANNELS = 64
_COARSE = 0.1  # samples: of a date with a coarser last digit a time difference is no better


def read_sigmf(path: Path | str) -> list[IqRecording]:
    """Read a recording, those of a collection, or all those of an archive, with all of their captures and channels.

    Parameters
    ----------
    path : path
        ``.sigmf-meta``, ``.sigmf-data``, ``.sigmf-collection``, or an archive ``.sigmf`` (also ``.gz``, ``.xz``,
        ``.zip``).

    Returns
    -------
    list of IqRecording
        Of an archive in the order of their names, of a collection in its own.

    Raises
    ------
    UserError
        Naming the file, what is wrong and what is allowed: missing or broken files, data that are cut off (no whole
        number of samples, fewer than captures or annotations say, or another checksum), fields of the metadata.
    """
    file = Path(path)
    try:
        if file.name.lower().endswith(_ARCHIVES) and file.exists():
            return _archived(file)
        if file.name.endswith(_COLLECTION):
            return _collected(file)
        base = _base(file)
        meta, archive = base.with_name(base.name + _META), base.with_name(base.name + ".sigmf")
        if not meta.exists() and archive.is_file():
            return _archived(archive)
        return [_alone(meta)]
    except Unreadable as error:
        raise UserError(f"FILE: {error}") from error


def _base(file: Path) -> Path:
    """Return the path of a recording without its ending."""
    for ending in (_META, _DATA, ".sigmf"):
        if file.name.endswith(ending):
            return file.with_name(file.name.removesuffix(ending) or ".")
    return file


def _alone(meta: Path) -> IqRecording:
    metadata = _metadata(str(meta), read_bytes(meta, _LARGEST_META))
    name = _dataset(str(meta), metadata, meta.name.removesuffix(_META) + _DATA)
    data = meta.with_name(name)
    if not data.exists():
        raise UserError(f"FILE: {meta}: its data are missing; {name[:80]} beside it")
    return _content(str(meta), meta.name.removesuffix(_META), metadata, FileData(data))


def _archived(archive: Path) -> list[IqRecording]:
    """Return all recordings of an archive."""
    members = members_of(archive)
    metas = sorted(name for name in members if name.endswith(_META))
    if not metas:
        raise UserError(f"FILE: {archive} holds no recording; a file that ends in {_META} is needed")
    recordings, used = [], set()
    for meta in metas:
        folder, _, name = meta.rpartition("/")
        where = f"{archive}, {name}"
        metadata = _metadata(where, members[meta])
        own = _dataset(where, metadata, name.removesuffix(_META) + _DATA)
        data = f"{folder}/{own}" if folder else own
        if data not in members:
            raise UserError(f"FILE: {where}: its data are missing; {own[:80]} beside it")
        used.add(data)
        recordings.append(_content(where, name.removesuffix(_META), metadata, BytesData(members[data])))
    lonely = sorted(name for name in members if name.endswith(_DATA) and name not in used)
    if lonely:
        raise UserError(f"FILE: {archive}: {lonely[0]} has no file beside it that ends in {_META}")
    return recordings


def _collected(file: Path) -> list[IqRecording]:
    """Return the recordings of a collection."""
    about = _object(str(file), read_bytes(file, _LARGEST_META)).get("collection")
    streams = about.get("core:streams") if isinstance(about, dict) else None
    entries = [one if isinstance(one, dict) else {} for one in streams] if isinstance(streams, list) else []
    names = [entry.get("name") for entry in entries]
    for name in names or [None]:
        if not isinstance(name, str) or not _plain(name):
            shown = json.dumps(streams)[:60]
            raise UserError(f"FILE: {file}: core:streams: {shown} is not allowed; a list of objects with a name")
    found = []
    for entry, name in zip(entries, names, strict=True):
        meta = file.with_name(f"{name}{_META}")
        if "hash" in entry and FileData(meta).sha512() != entry["hash"]:
            raise UserError(f"FILE: {file}: core:streams: {meta.name} is another file than the collection's (hash)")
        found.append(_alone(meta))
    return found


def _plain(name: str) -> bool:
    """Return whether it is a name of a file in the same folder."""
    return bool(name) and "\0" not in name and Path(name).name == name


def _object(where: str, content: bytes) -> dict[str, Any]:
    try:
        found = json.loads(content.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())[:120]
        raise UserError(f"FILE: {where} cannot be read as a SigMF recording ({reason})") from error
    if not isinstance(found, dict):
        raise UserError(f"FILE: {where}: {json.dumps(found)[:60]} is not allowed; an object")
    return found


def _metadata(where: str, content: bytes) -> dict[str, Any]:
    """Return metadata of the shape that they must have."""
    metadata = _object(where, content)
    if not isinstance(metadata.get("global"), dict):
        raise UserError(f"FILE: {where}: global is not allowed as it is; an object with core:datatype and others")
    for part in ("captures", "annotations"):
        entries = metadata.get(part, [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise UserError(f"FILE: {where}: {part}: {json.dumps(entries)[:60]} is not allowed; a list of objects")
    return metadata


def _dataset(where: str, metadata: Mapping[str, Any], usual: str) -> str:
    """Return the name of the file of samples."""
    about = metadata["global"]
    if about.get("core:metadata_only", False) is not False:
        shown = json.dumps(about["core:metadata_only"])[:60]
        raise UserError(f"FILE: {where}: core:metadata_only: {shown} is not allowed; false, with samples")
    name = about.get("core:dataset", usual)
    if not isinstance(name, str) or not _plain(name):
        shown = json.dumps(name)[:60]
        raise UserError(f"FILE: {where}: core:dataset: {shown} is not allowed; the name of a file beside it")
    return name


def _content(where: str, name: str, metadata: Mapping[str, Any], data: Data) -> IqRecording:
    """Return a recording; `where` is what an error calls it."""
    about = metadata["global"]
    captures, annotations = metadata.get("captures", []), metadata.get("annotations", [])
    try:
        kind = _type(about)
        channels = _channels(about)
        rate = finite("core:sample_rate", about.get("core:sample_rate"))
        if not rate >= _LEAST_RATE:
            raise ValueError(f"core:sample_rate {rate:g} is not allowed; a number >= {_LEAST_RATE:g} Hz")
        _check_hash(about, data)
        count = _count(about, captures, data.size, kind.size * channels)
        offset = whole("core:offset", about.get("core:offset", 0))
        found = captures_of(captures, annotations, offset, count)
        if count * channels > MOST_SAMPLES:
            raise ValueError(f"{count * channels} samples are not allowed; at most {MOST_SAMPLES}, cut it into parts")
        parts, start, begins = parts_of(found, rate)
        everywhere = place_of(about.get("core:geolocation"))
    except ValueError as error:
        raise UserError(f"FILE: {where}: {error}") from error
    segments = _segments(data, parts, kind, channels, rate)
    if not segments[0]:
        raise UserError(f"FILE: {where}: {count} real sample(s) are not allowed; at least two without a gap")
    places = _places(found, begins, everywhere)
    own = rate if kind.complex else 0.5 * rate
    notes = _notes(found, rate)
    if not kind.complex and any(part.frequency for part in parts):
        notes = (*notes, "its samples are real: core:frequency is taken to be that of 0 Hz in them")
    return IqRecording(name, own, segments[0], start, parts[0].first, segments[1:], places, notes)


def _type(about: Mapping[str, Any]) -> SampleType:
    try:
        return sample_type(about.get("core:datatype"), endless=True)
    except ValueError as error:
        raise ValueError(f"core:datatype: {error}") from error


def _channels(about: Mapping[str, Any]) -> int:
    channels = about.get("core:num_channels", 1)
    if not isinstance(channels, int) or isinstance(channels, bool) or not 1 <= channels <= _MOST_CHANNELS:
        raise ValueError(f"core:num_channels: {json.dumps(channels)[:60]} is not allowed; 1 to {_MOST_CHANNELS}")
    return channels


def _check_hash(about: Mapping[str, Any], data: Data) -> None:
    said = about.get("core:sha512")
    if said is not None and data.sha512() != (said.lower() if isinstance(said, str) else said):
        raise ValueError("its data are cut off or changed (core:sha512 is that of others)")


def _count(about: Mapping[str, Any], captures: Sequence[Mapping[str, Any]], size: int, each: int) -> int:
    """Return how many samples of all channels there are."""
    header = sum(whole("core:header_bytes", one.get("core:header_bytes", 0)) for one in captures)
    rest = size - header - whole("core:trailing_bytes", about.get("core:trailing_bytes", 0))
    if rest < 0 or rest % each:
        raise ValueError(f"its data are cut off: {rest} bytes of samples are no multiple of {each} bytes")
    return rest // each


def _segments(
    data: Data, parts: Sequence[Part], kind: SampleType, channels: int, rate: float
) -> tuple[tuple[Segment, ...], ...]:
    """Return the segments of each channel."""
    width = 2 if kind.complex else 1
    found: list[list[Segment]] = [[] for _ in range(channels)]
    for part in parts:
        at = part.header + part.first * kind.size * channels
        raw = data.numbers(kind.dtype, at, part.count * channels * width)
        tuned = part.frequency if kind.complex else part.frequency + 0.25 * rate
        for own, samples in zip(found, segments_of(raw, channels, kind.complex, kind.numbers), strict=True):
            if samples.size:
                own.append(Segment(samples, tuned, part.begin, part.dated))
    return tuple(tuple(own) for own in found)


def _places(
    captures: Sequence[Capture], begins: Sequence[float], everywhere: tuple[float, float, float] | None
) -> np.ndarray[Any, np.dtype[np.float64]] | None:
    """Return where the receiver was when; None: nobody knows."""
    rows = [(begin, *one.place) for one, begin in zip(captures, begins, strict=True) if one.place is not None]
    if not rows and everywhere is not None:
        rows = [(0.0, *everywhere)]
    return np.array(rows) if rows else None


def _notes(captures: Sequence[Capture], rate: float) -> tuple[str, ...]:
    """Return what is doubtful about the dates."""
    dated = next((one for one in captures if one.stamp is not None), None)
    if dated is None or dated.resolution * rate <= _COARSE:
        return ()
    return (
        f"its date has digits down to {dated.resolution:g} s, {dated.resolution * rate:.3g} samples: time differences "
        "are no better unless it begins there exactly",
    )
