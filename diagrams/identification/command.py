"""What ``quietfix identify`` does: a table, a verdict, and files that say the same."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from quietfix.diagrams.console.answer import asked_for_json, tell
from quietfix.diagrams.console.tables import print_table
from quietfix.diagrams.console.terminal import done, say
from quietfix.diagrams.identification.locating import Located, locate
from quietfix.diagrams.identification.priors import ORDERS, Priors
from quietfix.diagrams.identification.ranking import Ranking, rank
from quietfix.diagrams.identification.report import cautions, entry, table_of, verdict
from quietfix.diagrams.identification.station_report import (
    station_entry,
    station_geojson,
    station_table,
    station_verdict,
)
from quietfix.diagrams.readers.doppler.elements import Elements, read_elements
from quietfix.diagrams.readers.doppler.received import Received, read_received
from quietfix.diagrams.readers.doppler.station import carrier_of, read_station
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.systems.earth.geodetic import geodetic_to_ecef

__all__ = ["Asked", "find_station", "identify", "identify_command"]

_HEIGHT = 300.0, 500.0  # m, where nobody says how high a station is
_KNOWN = 30.0  # m, where somebody does
_HIGHEST = 1e4  # m


@dataclass(frozen=True)
class Asked:
    """What is to be identified, and how.

    Attributes
    ----------
    file, tle : Path
        Received frequencies; two-line elements.
    station : str, optional
        See `quietfix.diagrams.readers.doppler.station.read_station`; None: it is looked for.
    object : str, optional
        Number or name of the only object that counts.
    height : float, optional
        Of a station that is looked for, above the ellipsoid [m]; None: 300, give or take 500.
    carrier_mhz : float, optional
        None: as the station's file says, else the middle of the frequencies.
    start, time_column, frequency_column : str, optional
        See `quietfix.diagrams.readers.doppler.received.read_received`.
    oscillator : str
        Its last state: bias, drift or rate.
    time_sigma : float, optional
        Standard deviation of the time that an object is ahead of its elements [s]; None: by their age.
    """

    file: Path
    tle: Path
    station: str | None = None
    object: str | None = None
    height: float | None = None
    carrier_mhz: float | None = None
    start: str | None = None
    time_column: str | None = None
    frequency_column: str | None = None
    oscillator: str = "drift"
    time_sigma: float | None = None


def identify(asked: Asked) -> tuple[Ranking, Received, Priors]:
    """Return which objects explain a recording how well.

    Raises
    ------
    UserError
        If a file or an option cannot be.
    """
    received, elements, priors, notes = _read(asked)
    if asked.station is None:
        raise UserError("--station: none is given")
    latitude, longitude, height = read_station(asked.station)
    station = geodetic_to_ecef(np.radians(latitude), np.radians(longitude), height)
    ranking = rank(received, elements, station, priors)
    ranking.notes[:0] = notes
    return ranking, received, priors


def find_station(asked: Asked) -> tuple[Located, Received, Priors]:
    """Return where a station is that heard an object.

    Raises
    ------
    UserError
        If a file or an option cannot be, or it is not said which object.
    """
    received, elements, priors, notes = _read(asked)
    if len({one.number for one in elements}) > 1:
        raise UserError(
            f"--object: none is given, and {asked.tle.name} has {len(elements)}; the number or name of the one that "
            "was heard, or --station to find out which"
        )
    if asked.height is not None and not abs(asked.height) <= _HIGHEST:
        raise UserError(f"--height-m: {asked.height:g} is not allowed; at most {_HIGHEST:g} in size")
    height = _HEIGHT if asked.height is None else (asked.height, _KNOWN)
    began = received.second + received.rest
    located = locate(received, min(elements, key=lambda one: abs(one.epoch - began)), *height, priors)
    located.notes[:0] = notes
    return located, received, priors


def _read(asked: Asked) -> tuple[Received, list[Elements], Priors, list[str]]:
    """Return frequencies, objects, what is believed before, and notes."""
    choose("--oscillator", asked.oscillator, ORDERS)
    for name, value in (("--carrier-mhz", asked.carrier_mhz), ("--time-sigma", asked.time_sigma)):
        if value is not None and not 0 < value < 1e7:
            raise UserError(f"{name}: {value:g} is not allowed; > 0 and below 1e7")
    if asked.station is not None and asked.height is not None:
        raise UserError("--height-m: it is not allowed with --station, which has its own")
    known = None if asked.station is None else carrier_of(asked.station)
    carrier = known if asked.carrier_mhz is None else 1e6 * asked.carrier_mhz
    received = read_received(asked.file, carrier, asked.start, asked.time_column, asked.frequency_column)
    elements, notes = read_elements(asked.tle)
    if asked.object is not None:
        wanted = asked.object.strip()
        mine = [one for one in elements if wanted in (one.number, one.number.lstrip("0"), one.name, one.label)]
        if not mine:
            choose("--object", wanted, [one.label for one in elements[:20]])
        elements = mine
    return received, elements, Priors(time=asked.time_sigma, order=ORDERS[asked.oscillator]), notes


def identify_command(asked: Asked, out: Path | None, overwrite: bool) -> None:
    """Identify an object or find a station, and say what is to be believed; see ``quietfix identify --help``."""
    if out is None:
        _told(asked, None)
        return
    with OutputFolder(out, overwrite, "identify") as folder:
        names = _told(asked, folder.work)
        folder.finish()
    tell(folder=str(out))
    done(f"wrote {out}: {', '.join(names)}")


def _told(asked: Asked, folder: Path | None) -> list[str]:
    """Print what is found, write it into a folder, and return the names of the files."""
    files: dict[str, dict[str, Any]] = {}
    if asked.station is None:
        located, received, priors = find_station(asked)
        table, notes, words = station_table(located, received), located.notes, station_verdict(located)
        files = {
            "station.json": station_entry(located, received, priors),
            "station.geojson": station_geojson(located),
        }
    else:
        ranking, received, priors = identify(asked)
        table, words = table_of(ranking, received, priors), verdict(ranking)
        notes = [*ranking.notes, *cautions(ranking, priors)]
        files = {"identification.json": entry(ranking, received, priors)}
    if folder is not None:
        for name, content in files.items():
            text = json.dumps(content, indent=1, allow_nan=False)
            (folder / name).write_text(text + "\n", encoding="utf-8")
    tell(**next(iter(files.values())))
    if not asked_for_json():  # the object has notes and verdict of its own
        print_table(table)
        for note in [*received.notes, *notes]:
            say(note)
        say(words)
    return list(files)
