"""Receivers by their names, and where they stood: from a table of the user's, or from what recordings say."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.platforms import read_platforms
from quietfix.diagrams.readers.stamps import write_stamps
from quietfix.diagrams.schema.errors import UserError, shown

__all__ = ["Known", "ReceiverTrack", "known_by_table", "known_by_tracks", "named"]

Array = NDArray[np.float64]

_STANDS = 1e-9


@dataclass(frozen=True, eq=False)
class ReceiverTrack:
    """Where a receiver was, as its recording says.

    Attributes
    ----------
    time : ndarray, shape (k,)
        Since the first sample of all recordings [s]; of one place it does not matter.
    place : ndarray, shape (k, 3)
        Latitude, longitude [deg], height above the ellipsoid [m].
    """

    time: Array
    place: Array


@dataclass(frozen=True, eq=False)
class Known:
    """Where receivers stand, as a table.

    Attributes
    ----------
    content : bytes
        The table.
    suffix : str
        Of its file.
    names : dict of str to str
        Name in the table of each receiver that is in it.
    moving : bool
        Whether one of them moves.
    absent : list of str
        Receivers of which nobody knows where they are.
    """

    content: bytes
    suffix: str
    names: dict[str, str]
    moving: bool
    absent: list[str]


def named(recordings: Sequence[str], chosen: Sequence[str]) -> list[str]:
    """Return names of receivers: those that are chosen, or made from the recordings'; letters, digits and _.

    Raises
    ------
    UserError
        For as many as there are not, or one that is not allowed or there twice.
    """
    if chosen:
        if len(chosen) != len(recordings):
            raise UserError(f"receivers: {len(chosen)} names are not allowed for {len(recordings)} recordings")
        for name in chosen:
            if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", name):
                raise UserError(f"receivers: {name[:60]!r} is not allowed; letters, digits and _, a letter first")
        if len(set(chosen)) < len(chosen):
            raise UserError(f"receivers: {', '.join(chosen)} has a name twice")
        return list(chosen)
    found: list[str] = []
    for name in recordings:
        plain = _plain(name)
        found.append(plain if plain not in found else f"{plain}_{len(found) + 1}")
    return found


def _plain(name: str) -> str:
    plain = re.sub(r"[^A-Za-z0-9_]", "_", name)[:60]
    return plain if plain[:1].isalpha() and plain.isascii() else f"r_{plain}"


def known_by_table(file: Path, receivers: Mapping[str, str]) -> Known:
    """Return what a table of platforms says of receivers, given with the names of their recordings.

    A receiver is found by its own name, by that of its recording, or by one that differs in other signs than letters
    and digits only.

    Raises
    ------
    UserError
        As `quietfix.diagrams.readers.platforms.read_platforms`, and if it has none of them.
    """
    table = read_platforms(file).platforms
    plain = {_plain(name).lower(): name for name in reversed(list(table))}
    names = {}
    for receiver, recording in receivers.items():
        for candidate in (receiver, recording):
            other = candidate if candidate in table else plain.get(_plain(candidate).lower())
            if other is not None and receiver not in names:
                names[receiver] = other
    if not names:
        raise UserError(
            f"{shown(file)}: none of the receivers {', '.join(receivers)} is in it, only "
            f"{', '.join(list(table)[:8])}; names of recordings, or --set 'receivers=[...]' in the order of the files"
        )
    moving = any(table[name].rest is not None for name in names.values())
    return Known(file.read_bytes(), file.suffix, names, moving, [one for one in receivers if one not in names])


def known_by_tracks(tracks: Mapping[str, ReceiverTrack | None], began: tuple[int, float] | None) -> Known | None:
    """Return what recordings say of their receivers; None where they say nothing.

    Parameters
    ----------
    tracks : mapping of str to ReceiverTrack or None
    began : (int, float), optional
        First sample of all, seconds of TAI since 1970; None: nobody knows.
    """
    there = {name: track for name, track in tracks.items() if track is not None and len(track.place)}
    if not there:
        return None
    lines, moving = [], False
    for name, track in there.items():
        stands = bool((np.ptp(track.place, axis=0) <= _STANDS).all())
        moving = moving or not stands
        count = 1 if stands else len(track.place)
        if stands:
            times = [""]
        elif began is None:
            times = [repr(float(t)) for t in track.time]
        else:
            times = write_stamps(began, track.time)
        for time, place in zip(times, track.place[:count].tolist(), strict=True):
            lines.append(f"{name},{time},{place[0]!r},{place[1]!r},{place[2]!r}\n")
    head = f"name,{'time_s' if began is None else 'time'},latitude_deg,longitude_deg,height_m\n"
    absent = [name for name in tracks if name not in there]
    return Known((head + "".join(lines)).encode(), ".csv", {name: name for name in there}, moving, absent)
