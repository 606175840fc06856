"""Reading a folder of KiwiSDR recordings: three receivers, and the transmitter that they hear."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.data import Source
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.geodetic import geodetic_to_ecef
from quietfix.systems.files import read_text
from quietfix.systems.iq.kiwi import GpsRecording, read_kiwi

__all__ = ["SOURCE", "KiwiData", "read_folder"]

Array = NDArray[np.float64]

_STATIONS = "stations.csv"

SOURCE = Source(
    folder="kiwisdr_dcf77",
    origin="hcab14/TDoA at 2bb9dc2, iq/20200813T065220Z_77500_*_iq.wav (Christoph Mayer)",
    holds=_STATIONS,
)


@dataclass(frozen=True, eq=False)
class KiwiData:
    """What is in the folder.

    Attributes
    ----------
    names : list of str
        Of the receivers.
    recordings : list of GpsRecording
    stations : ndarray, shape (p, 3)
        Where the receivers are, on the ellipsoid, Earth-fixed [m].
    mast : ndarray, shape (3,)
        Where the transmitter is; for scoring only.
    transmitter : str
        Its name.
    """

    names: list[str]
    recordings: list[GpsRecording]
    stations: Array
    mast: Array
    transmitter: str

    @property
    def still(self) -> Array:
        """Earth-fixed states of the receivers, shape (p, 6)."""
        return np.concatenate([self.stations, np.zeros_like(self.stations)], axis=1)


def read_folder(folder: Path) -> KiwiData:
    """Read stations and recordings.

    Raises
    ------
    UserError
        If something is missing or broken; it names file, the ways to name another folder, and the public source.
    """
    try:
        places = _stations(folder / _STATIONS)
        masts = [name for name, (role, _) in places.items() if role == "transmitter"]
        names = [name for name, (role, _) in places.items() if role == "receiver"]
        if len(masts) != 1 or len(names) != 3:
            raise ValueError(
                f"{folder / _STATIONS}: {len(names)} receivers and {len(masts)} transmitters are not allowed; 3 and 1"
            )
        recordings = [read_kiwi(_file(folder, name)) for name in names]
    except (csv.Error, ValueError) as error:
        raise UserError(
            f"data: {error}; name another folder with --data DIR or in the environment variable QUIETFIX_DATA; "
            f"source: {SOURCE.origin}"
        ) from error
    stations = np.array([places[name][1] for name in names])
    return KiwiData(names, recordings, stations, places[masts[0]][1], masts[0])


def _file(folder: Path, name: str) -> Path:
    found = sorted(folder.glob(f"*_{name}_iq.wav"))
    if len(found) != 1:
        raise ValueError(f"{folder}: {len(found)} files *_{name}_iq.wav are not allowed; one")
    return found[0]


def _stations(file: Path) -> dict[str, tuple[str, Array]]:
    """Return role and Earth-fixed position of every station, by name."""
    columns = ("name", "role", "latitude_deg", "longitude_deg")
    with io.StringIO(read_text(file), newline="") as stream:
        reader = csv.DictReader(stream)
        absent = [column for column in columns if column not in (reader.fieldnames or [])]
        if absent:
            raise ValueError(f"{file}: column {absent[0]} is missing")
        places = {}
        for row in reader:
            try:
                latitude, longitude = (math.radians(float(row[column])) for column in columns[2:])
            except (TypeError, ValueError) as error:
                raise ValueError(f"{file} line {reader.line_num}: latitude and longitude must be numbers") from error
            if not (abs(latitude) <= math.pi / 2 and abs(longitude) <= 2 * math.pi):
                raise ValueError(f"{file} line {reader.line_num}: latitude is -90 to 90, longitude -360 to 360")
            places[row["name"]] = row["role"], geodetic_to_ecef(latitude, longitude, 0.0)
    return places
