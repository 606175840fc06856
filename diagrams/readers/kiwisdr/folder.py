"""Reading a folder of KiwiSDR recordings: any receivers, and the transmitter that they hear, if anybody knows it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.data import Source
from quietfix.diagrams.readers.kiwisdr.stations import Station, file_of_stations, read_stations, same_name
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.time_scales import to_posix
from quietfix.systems.iq.kiwi import GpsRecording, KiwiFile, read_kiwi
from quietfix.systems.iq.stamped import WEEK

__all__ = ["SOURCE", "KiwiData", "read_folder"]

Array = NDArray[np.float64]

_NAMED = re.compile(r"(?P<time>\d{8}T\d{6}Z)_(?P<frequency>\d+(?:\.\d+)?)_(?P<name>.+?)(?:_iq)?")
_FEWEST = 3
_GPS_ZERO = 315964800  # 1980-01-06 in seconds since 1970
_LEAP = 18  # s that GPS is ahead of UTC since 2017; only whether a stamp and a file's name fit depends on it
_OFF = 600.0  # s that the stamps may be off the time in the file's name

SOURCE = Source(
    folder="kiwisdr_dcf77",
    origin="hcab14/TDoA at 2bb9dc2, iq/20200813T065220Z_77500_*_iq.wav (Christoph Mayer)",
    holds="*.wav",
)


@dataclass(frozen=True, eq=False)
class KiwiData:
    """What is in the folder.

    Attributes
    ----------
    names : list of str
        Of the receivers.
    recordings : list of KiwiFile
    stations : ndarray, shape (p, 3)
        Where the receivers are, on the ellipsoid, Earth-fixed [m].
    mast : ndarray, shape (3,)
        Where the transmitter is, for scoring only; NaN: nobody knows.
    transmitter : str
        Its name; empty: nobody knows.
    frequency : float
        To which the receivers were tuned [Hz].
    posix : float
        When it began, seconds since 1970 to within some minutes; NaN: no file says.
    left_out : list of str
        What is in the folder but not used, and what is wrong with what is, a line for each.
    """

    names: list[str]
    recordings: list[KiwiFile]
    stations: Array
    mast: Array
    transmitter: str
    frequency: float
    posix: float = np.nan
    left_out: list[str] = field(default_factory=list)

    @property
    def still(self) -> Array:
        """Earth-fixed states of the receivers, shape (p, 6)."""
        return np.concatenate([self.stations, np.zeros_like(self.stations)], axis=1)

    @property
    def parts(self) -> list[tuple[GpsRecording, ...]]:
        """The pieces of each recording."""
        return [one.parts for one in self.recordings]

    def reordered(self, order: Sequence[int]) -> KiwiData:
        """Return the same with the receivers in another order."""
        return replace(
            self,
            names=[self.names[i] for i in order],
            recordings=[self.recordings[i] for i in order],
            stations=self.stations[list(order)],
        )


class _File(NamedTuple):
    """A recording and what its name says: receiver, frequency [Hz] or NaN, seconds since 1970 or NaN."""

    path: Path
    name: str
    frequency: float
    posix: float


def read_folder(folder: Path, platforms: str = "", frequency: float = 0.0) -> KiwiData:
    """Read stations and recordings.

    Parameters
    ----------
    folder : Path
        Files ``TIME_FREQUENCY_NAME_iq.wav`` (TIME as 20200813T065220Z, FREQUENCY in Hz), as KiwiSDRs and their recorder
        name them, or ``NAME.wav``.
    platforms : str
        The table of stations; by default see `file_of_stations`.
    frequency : float
        Only recordings of this frequency [Hz], and that of files whose names do not tell; 0: the names tell.

    Raises
    ------
    UserError
        If something is missing or broken; it names file, the ways to name another folder, and the public source.
    """
    try:
        file = file_of_stations(folder, platforms)
        places = read_stations(file)
        masts = [name for name, one in places.items() if one.role == "transmitter"]
        if len(masts) > 1:
            raise ValueError(
                f"{file}: {len(masts)} transmitters ({', '.join(masts[:5])}) are not allowed; one, or none"
            )
        files, tuned = _of_one_frequency(folder, _files(folder), frequency)
        return _read(folder, file, files, places, masts[0] if masts else "", tuned)
    except ValueError as error:
        raise UserError(
            f"data: {error}; name another folder with --data DIR or in the environment variable QUIETFIX_DATA; "
            f"source: {SOURCE.origin}"
        ) from error


def _read(
    folder: Path, table: Path, files: list[_File], places: dict[str, Station], mast: str, tuned: float
) -> KiwiData:
    """Return what the files hold; a receiver that cannot be used is left out, and said."""
    receivers = [name for name, one in places.items() if one.role == "receiver"]
    found: dict[str, tuple[KiwiFile, _File]] = {}
    said: list[str] = []
    for file in files:
        station = same_name(file.name, receivers)
        if station is None:
            said.append(f"{file.name}: left out: {table.name} does not say where it stands")
        elif station in found:
            said.append(f"{file.path.name}: left out: {found[station][1].path.name} is of the same receiver")
        else:
            try:
                found[station] = read_kiwi(file.path), file
            except ValueError as error:
                said.append(f"{station}: left out: {error}")
    absent = [name for name in receivers if name not in {same_name(file.name, receivers) for file in files}]
    said += [f"{name}: left out: {folder.name} holds no recording of it" for name in absent]
    if len(found) < _FEWEST:
        why = f" ({'; '.join(said)})" if said else ""
        raise ValueError(
            f"{folder}: {len(found)} receivers with a recording and a place are not allowed; at least {_FEWEST}{why}"
        )
    names = [name for name in receivers if name in found]
    for name in names:
        recording, file = found[name]
        said += [f"{name}: {note}" for note in (*recording.notes(), *_dated(recording, file))]
    posix = [file.posix for _, file in found.values()]
    return KiwiData(
        names,
        [found[name][0] for name in names],
        np.array([places[name].place for name in names]),
        places[mast].place if mast else np.full(3, np.nan),
        mast,
        tuned,
        float(np.nanmin(posix)) if np.isfinite(posix).any() else np.nan,
        said,
    )


def _files(folder: Path) -> list[_File]:
    found = []
    for path in sorted(folder.glob("*.wav")):
        match = _NAMED.fullmatch(path.stem)
        if match is None:
            found.append(_File(path, path.stem.removesuffix("_iq"), np.nan, np.nan))
            continue
        text = match["time"]
        try:
            posix = float(to_posix(f"{text[:4]}-{text[4:6]}-{text[6:11]}:{text[11:13]}:{text[13:]}")[0])
        except ValueError:
            posix = np.nan
        found.append(_File(path, match["name"], float(match["frequency"]), posix))
    return found


def _of_one_frequency(folder: Path, files: list[_File], asked: float) -> tuple[list[_File], float]:
    """Return the recordings of one frequency, and it [Hz]."""
    heard = sorted({one.frequency for one in files if np.isfinite(one.frequency)})
    if not files:
        raise ValueError(f"{folder}: it holds no recording *.wav; at least {_FEWEST}")
    if not asked and len(heard) != 1:
        names = ", ".join(f"{one:.10g}" for one in heard[:5]) or "none"
        raise ValueError(
            f"{folder}: the frequencies that its files' names tell are not allowed ({names}); one, or say which "
            "(--set carrier_hz=...)"
        )
    tuned = asked or heard[0]
    chosen = [one for one in files if not abs(one.frequency - tuned) > 0.5]
    if not chosen:
        raise ValueError(f"{folder}: no recording of {tuned:.10g} Hz; {', '.join(f'{one:.10g}' for one in heard[:5])}")
    return chosen, tuned


def _dated(recording: KiwiFile, file: _File) -> list[str]:
    """Return a note where the stamps are not those of the time in the file's name."""
    if not np.isfinite(file.posix):
        return []
    off = recording.parts[0].start - (file.posix - _GPS_ZERO + _LEAP)
    off -= WEEK * round(off / WEEK)
    return (
        [] if abs(off) < _OFF else [f"its stamps are {off:.0f} s off the time in its file's name; are they GPS time?"]
    )
