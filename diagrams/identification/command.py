"""What ``quietfix identify`` does: a table, a verdict, ``identification.json``, a figure."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from diagrams.console.tables import print_table
from diagrams.console.terminal import say
from diagrams.identification.ranking import ORDERS, Priors, Ranking, rank
from diagrams.identification.report import cautions, entry, table_of, verdict
from diagrams.readers.doppler.elements import read_elements
from diagrams.readers.doppler.received import Received, read_received
from diagrams.readers.doppler.station import carrier_of, read_station
from diagrams.schema.errors import UserError, choose
from diagrams.studies.output import OutputFolder
from systems.earth.geodetic import geodetic_to_ecef

__all__ = ["Asked", "identify", "identify_command"]


@dataclass(frozen=True)
class Asked:
    """What is to be identified, and how.

    Attributes
    ----------
    file, tle : Path
        Received frequencies; two-line elements.
    station : str
        See `diagrams.readers.doppler.station.read_station`.
    carrier_mhz : float, optional
        None: as the station's file says, else the middle of the frequencies.
    start, time_column, frequency_column : str, optional
        See `diagrams.readers.doppler.received.read_received`.
    oscillator : str
        Its last state: bias, drift or rate.
    time_sigma : float, optional
        Standard deviation of the time that an object is ahead of its elements [s]; None: by their age.
    """

    file: Path
    tle: Path
    station: str
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
    choose("--oscillator", asked.oscillator, ORDERS)
    for name, value in (("--carrier-mhz", asked.carrier_mhz), ("--time-sigma", asked.time_sigma)):
        if value is not None and not 0 < value < 1e7:
            raise UserError(f"{name}: {value:g} is not allowed; > 0 and below 1e7")
    latitude, longitude, height = read_station(asked.station)
    carrier = 1e6 * asked.carrier_mhz if asked.carrier_mhz is not None else carrier_of(asked.station)
    received = read_received(asked.file, carrier, asked.start, asked.time_column, asked.frequency_column)
    elements, notes = read_elements(asked.tle)
    station = geodetic_to_ecef(np.radians(latitude), np.radians(longitude), height)
    priors = Priors(time=asked.time_sigma, order=ORDERS[asked.oscillator])
    ranking = rank(received, elements, station, priors)
    ranking.notes[:0] = notes
    return ranking, received, priors


def identify_command(asked: Asked, out: Path | None, overwrite: bool) -> None:
    """Identify an object, print a table and what is to be believed; see ``quietfix identify --help``."""
    if out is None:
        _print(*identify(asked))
        return
    with OutputFolder(out, overwrite, "identify") as folder:
        ranking, received, priors = identify(asked)
        text = json.dumps(entry(ranking, received, priors), indent=1, allow_nan=False)
        (folder.work / "identification.json").write_text(text + "\n", encoding="utf-8")
        folder.finish()
    _print(ranking, received, priors)
    print(f"wrote {out}: identification.json")


def _print(ranking: Ranking, received: Received, priors: Priors) -> None:
    print_table(table_of(ranking, received, priors))
    for note in [*received.notes, *ranking.notes, *cautions(ranking)]:
        say(note)
    say(verdict(ranking))
