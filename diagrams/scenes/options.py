"""What ``quietfix play`` takes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from quietfix.diagrams.console.arguments import JSON, RUN_SEED, SCENARIO, SET, number, whole

__all__ = ["play"]


def play(
    what: Annotated[
        str,
        typer.Argument(
            metavar="RESULT|SYSTEM[:VARIANT]",
            help="A folder that run or replay wrote, or a system, of which a few trials are run.",
            show_default=False,
        ),
    ],
    html: Annotated[
        Path | None,
        typer.Option(
            "--html",
            "--out",
            metavar="FILE",
            help="Write one page that needs no network, and do not wait.",
            show_default=False,
        ),
    ] = None,
    czml: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write it as CZML, for Cesium, and do not wait.", show_default=False),
    ] = None,
    origin: Annotated[
        str | None,
        typer.Option(
            metavar="LAT,LON[,H]", help="With --czml: where the origin of flat axes is [deg, m].", show_default=False
        ),
    ] = None,
    estimators: Annotated[
        list[str] | None,
        typer.Option("--estimator", metavar="NAME", help="Show these. Repeatable.  [default: the first one]"),
    ] = None,
    trial: Annotated[
        int | None,
        typer.Option(parser=whole, metavar="N", help="The trial that is shown; others are dots.  [default: the first]"),
    ] = None,
    magnify: Annotated[
        float | None,
        typer.Option(
            parser=number, metavar="F", help="Draw errors and ellipsoids so many times as large.  [default: as needed]"
        ),
    ] = None,
    trials: Annotated[
        int | None, typer.Option(parser=whole, metavar="N", help="Of a system: trials to run.  [default: 5]")
    ] = None,
    seed: Annotated[int | None, RUN_SEED] = None,
    settings: Annotated[list[str] | None, SET] = None,
    scenario: Annotated[Path | None, SCENARIO] = None,
    as_json: Annotated[bool, JSON] = False,
) -> None:
    """Play a result in three dimensions, in a browser, with a time slider (Drake's Meshcat).

    Earth or ground, platforms, target, estimate with its ellipsoid, other trials as dots, lines of sight. Without
    --html and --czml it is served on this machine, at the address that is printed, until Ctrl-C.
    """
    from quietfix.diagrams.console.answer import answering
    from quietfix.diagrams.scenes.command import Written, play_command

    asked = {"trials": trials, "seed": seed, "set": settings, "scenario": scenario}
    given = {k: v for k, v in asked.items() if v is not None}
    with answering(as_json):  # before it waits, where it serves
        serving = play_command(what, Written(html, czml, origin), estimators, trial, magnify, given)
    if serving is not None:
        serving()
