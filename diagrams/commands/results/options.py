"""What ``quietfix inspect``, ``plot``, ``diff`` and ``export`` take; what they do is in files of their own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from quietfix.diagrams.console.arguments import OVERWRITE, number, whole

__all__ = ["diff", "export", "inspect", "plot"]

_RESULT = typer.Argument(metavar="RESULT", help="Folder of a run, compare, sweep or replay.", show_default=False)
_ONLY = typer.Option("--estimator", metavar="NAME", help="Only this one. Repeatable.  [default: all]")


def inspect(
    result: Annotated[Path, _RESULT],
    worst: Annotated[int, typer.Option(parser=whole, metavar="N", help="How many of the worst trials.")] = 5,
    trial: Annotated[
        int | None, typer.Option(parser=whole, metavar="N", help="Only this trial, with its course over time.")
    ] = None,
    estimators: Annotated[list[str] | None, _ONLY] = None,
) -> None:
    """Show the worst trials of a result, or one: errors, NEES, whether it is lost or never started, and why."""
    from quietfix.diagrams.commands.results.inspecting import inspect_command

    inspect_command(result, worst, trial, estimators)


def plot(
    result: Annotated[Path, _RESULT],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where the figures go.  [default: RESULT-figures]")
    ] = None,
    overwrite: Annotated[bool, OVERWRITE] = False,
    trust: Annotated[
        bool, typer.Option("--trust", help="Import the system and the classes that the result names, for its diagram.")
    ] = False,
) -> None:
    """Draw the figures of a result again, as they were when it was made."""
    from quietfix.diagrams.commands.results.plotting import plot_command

    plot_command(result, out, overwrite, trust)


def diff(
    a: Annotated[Path, typer.Argument(metavar="A", help="A result.", show_default=False)],
    b: Annotated[Path, typer.Argument(metavar="B", help="Another one.", show_default=False)],
    at: Annotated[
        float | None, typer.Option(parser=number, metavar="T", help="Errors at this time [s].  [default: the end]")
    ] = None,
    estimators: Annotated[list[str] | None, _ONLY] = None,
) -> None:
    """Say how two results differ: what was asked, and errors with intervals, trial by trial where seeds are equal."""
    from quietfix.diagrams.commands.results.differing import diff_command

    diff_command(a, b, at, estimators)


def export(
    result: Annotated[Path, _RESULT],
    file: Annotated[
        Path, typer.Argument(metavar="FILE", help="Its name ends in .nc, .csv or .parquet.", show_default=False)
    ],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace FILE.")] = False,
) -> None:
    """Write a result as NetCDF, or as a table in CSV or Parquet: a row for each estimator, trial and epoch."""
    from quietfix.diagrams.commands.results.exporting import export_command

    export_command(result, file, overwrite)
