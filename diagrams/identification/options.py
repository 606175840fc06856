"""What ``quietfix identify`` takes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["identify"]


def identify(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="Received frequencies of one satellite: CSV or Parquet, a column of times, one of frequencies.",
            show_default=False,
        ),
    ],
    tle: Annotated[Path, typer.Option(metavar="FILE", help="Two-line elements of all objects that it may be.")],
    station: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON,H",
            help="The receiver [deg, deg, m], or a YAML or JSON file that says so.  [default: it is looked for]",
            show_default=False,
        ),
    ] = None,
    object_: Annotated[
        str | None,
        typer.Option("--object", metavar="NAME", help="The only object that counts, by number or name."),
    ] = None,
    height_m: Annotated[
        float | None, typer.Option(metavar="H", help="Height of a station that is looked for.", show_default=False)
    ] = None,
    carrier_mhz: Annotated[
        float | None,
        typer.Option(
            metavar="F",
            help="Nominal carrier.  [default: as the station's file says, or the middle of the frequencies]",
        ),
    ] = None,
    oscillator: Annotated[
        str, typer.Option(metavar="STATE", help="Last state of the oscillator: bias, drift or rate.")
    ] = "drift",
    time_sigma: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="Standard deviation of the time an object is ahead of its elements.  [default: by their age]",
        ),
    ] = None,
    start: Annotated[
        str | None, typer.Option(metavar="DATE", help="UTC that seconds in the file begin at.", show_default=False)
    ] = None,
    time_column: Annotated[
        str | None, typer.Option(metavar="NAME", help="Its column of times.", show_default=False)
    ] = None,
    frequency_column: Annotated[
        str | None, typer.Option(metavar="NAME", help="Its column of frequencies.", show_default=False)
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Write what was found here.")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace an earlier result in DIR.")] = False,
) -> None:
    """Say which satellite was heard: one-way Doppler at a known station against two-line elements.

    Without --station: say where the station is that heard an object, with its 99 % ellipse.
    """
    from quietfix.diagrams.identification.command import Asked, identify_command

    asked = Asked(
        file, tle, station, object_, height_m, carrier_mhz, start, time_column, frequency_column, oscillator, time_sigma
    )
    identify_command(asked, out, overwrite)
