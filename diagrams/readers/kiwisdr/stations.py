"""Where receivers and a transmitter stand: a table, or the files in which KiwiSDR's own programs keep it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.rows import chunks_of
from quietfix.systems.earth.geodetic import geodetic_to_ecef
from quietfix.systems.files import read_text

__all__ = ["STATIONS", "Station", "file_of_stations", "read_stations", "same_name"]

Array = NDArray[np.float64]

STATIONS = ("stations.csv", "platforms.csv")
_GNSS = "gnss_pos"  # the folder in which hcab14/TDoA keeps a file NAME.txt for each receiver
_WORDS = "name, latitude_deg, longitude_deg, and if there is a transmitter among them role (receiver, transmitter)"
_ROLES = ("receiver", "transmitter")
_NUMBER = r"\s*([-+0-9.eE]+)\s*"
_COORDINATES = re.compile(rf"'coord'\s*,\s*\[{_NUMBER},{_NUMBER}\]")


class Station(NamedTuple):
    """A place of the table: its role and where it is on the ellipsoid, Earth-fixed [m], shape (3,)."""

    role: str
    place: Array


def file_of_stations(folder: Path, named: str) -> Path:
    """Return the table, or the folder of the files, that says where the receivers of a folder stand.

    Raises
    ------
    ValueError
        If there is none.
    """
    if named:
        # a path is relative to where the program was started, and to the recordings
        return next((one for one in (Path(named), folder / named) if one.exists()), Path(named))
    found = [folder / name for name in (*STATIONS, _GNSS) if (folder / name).exists()]
    if not found and any(_COORDINATES.search(read_text(one)) for one in sorted(folder.glob("*.txt"))):
        found = [folder]
    if not found:
        raise ValueError(
            f"{folder}: nothing there says where the receivers stand; {STATIONS[0]} with columns {_WORDS}, or a table "
            "named by --platforms FILE"
        )
    return found[0]


def read_stations(file: Path) -> dict[str, Station]:
    """Return the stations by name.

    Parameters
    ----------
    file : Path
        A table, with any delimiter, whose columns are those of `_WORDS`; or a folder of files ``NAME.txt`` with
        ``'coord', [latitude, longitude]`` [deg] in them.

    Raises
    ------
    ValueError
        Naming file, line and value.
    """
    if file.is_dir():
        found = {one.stem: _COORDINATES.search(read_text(one)) for one in sorted(file.glob("*.txt"))}
        return {
            name: Station("receiver", _place(f"{file / name}.txt", match[1], match[2]))
            for name, match in found.items()
            if match
        }
    places: dict[str, Station] = {}
    for chunk in chunks_of(file, {"name", "latitude_deg", "longitude_deg"}.issubset, _WORDS):
        names = [str(name) for name in chunk.columns["name"]]
        roles = chunk.columns.get("role", ["receiver"] * len(names))
        sides = [chunk.columns[f"{side}_deg"] for side in ("latitude", "longitude")]
        for line, name, role, latitude, longitude in zip(chunk.lines, names, roles, *sides, strict=True):
            where = f"{file} line {line}"
            if not name or name in places:
                raise ValueError(f"{where}: name {name!r} is not allowed; one of its own for every station")
            if str(role).lower() not in _ROLES:
                raise ValueError(f"{where}: role {str(role)!r:.60} is not allowed; {' or '.join(_ROLES)}")
            places[name] = Station(str(role).lower(), _place(where, latitude, longitude))
    return places


def _place(where: str, latitude: str | float, longitude: str | float) -> Array:
    try:
        degrees = np.array([float(latitude), float(longitude)])
    except ValueError as error:
        raise ValueError(f"{where}: latitude and longitude must be numbers") from error
    if not (abs(degrees[0]) <= 90 and abs(degrees[1]) <= 360):
        raise ValueError(f"{where}: latitude is -90 to 90, longitude -360 to 360")
    return geodetic_to_ecef(np.radians(degrees[0]), np.radians(degrees[1]), 0.0)


def same_name(name: str, stations: Sequence[str]) -> str | None:
    """Return the station that a receiver's name in a file's name means: signs and capitals do not count."""

    def plain(text: str) -> str:
        return re.sub(r"[^a-z0-9]", "", text.lower())

    exact = [one for one in stations if one == name] or [one for one in stations if plain(one) == plain(name)]
    return exact[0] if len(exact) == 1 else None
