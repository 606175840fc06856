"""What ``quietfix compare``, ``sweep`` and ``verify`` take; what they do is in files of their own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from quietfix.diagrams.console.arguments import (
    AGAIN,
    CHUNK,
    COMPARED,
    DATA,
    ESTIMATOR,
    OVERWRITE,
    PAGE,
    SCENARIO,
    SCHEDULER,
    SEED,
    SET,
    SMOOTH,
    SYSTEM,
    THREADS,
    TRIALS,
    VARY,
    WORKERS,
    number,
    whole,
    with_smoothers,
)

__all__ = ["compare", "sweep", "verify"]


def compare(
    systems: Annotated[list[str], typer.Argument(metavar="SYSTEM[:VARIANT]...", help="One or more systems.")],
    estimators: Annotated[list[str] | None, COMPARED] = None,
    trials: Annotated[int | None, TRIALS] = None,
    seed: Annotated[int, SEED] = 0,
    at: Annotated[
        float | None, typer.Option(parser=number, metavar="T", help="RMSE at this time [s].  [default: the end]")
    ] = None,
    settings: Annotated[list[str] | None, SET] = None,
    scenario: Annotated[Path | None, SCENARIO] = None,
    format_: Annotated[str, typer.Option("--format", help="table or markdown.")] = "table",
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Write comparison.json, results, figures.")] = None,
    data: Annotated[list[Path] | None, DATA] = None,
    chunk: Annotated[int | None, CHUNK] = None,
    threads: Annotated[int, THREADS] = 1,
    resume: Annotated[Path | None, AGAIN] = None,
    workers: Annotated[int | None, WORKERS] = None,
    scheduler: Annotated[str | None, SCHEDULER] = None,
    overwrite: Annotated[bool, OVERWRITE] = False,
    report: Annotated[bool, PAGE] = False,
    smooth: Annotated[bool, SMOOTH] = False,
) -> None:
    """Compare estimators on one stream of measurements: errors, bounds, consistency, cost, who is the best."""
    from quietfix.diagrams.commands.judging.comparing import compare_command
    from quietfix.diagrams.pages.command import paged

    options: dict[str, Any] = {
        "estimators": with_smoothers(estimators, smooth),
        "trials": trials,
        "seed": seed,
        "set": settings,
        "scenario": scenario,
    }
    options |= {"data": data, "chunk": chunk, "threads": threads}
    with paged(report, out or resume):
        compare_command(systems, options, at, format_, out, overwrite, resume, workers, scheduler, report)


def sweep(
    system: Annotated[str, SYSTEM],
    vary: Annotated[str, VARY],
    estimators: Annotated[list[str] | None, ESTIMATOR] = None,
    trials: Annotated[int, typer.Option(parser=whole, metavar="N", help="Monte Carlo trials.")] = 100,
    seed: Annotated[int, SEED] = 0,
    at: Annotated[
        float | None, typer.Option(parser=number, metavar="T", help="Errors at this time [s].  [default: the end]")
    ] = None,
    settings: Annotated[list[str] | None, SET] = None,
    scenario: Annotated[Path | None, SCENARIO] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Write sweep.json, results and a figure.")] = None,
    chunk: Annotated[int | None, CHUNK] = None,
    threads: Annotated[int, THREADS] = 1,
    resume: Annotated[Path | None, AGAIN] = None,
    workers: Annotated[int | None, WORKERS] = None,
    scheduler: Annotated[str | None, SCHEDULER] = None,
    overwrite: Annotated[bool, OVERWRITE] = False,
    report: Annotated[bool, PAGE] = False,
) -> None:
    """Vary one number of a scenario on the same noise: what a mismatch costs, and whether the covariance tells."""
    from quietfix.diagrams.commands.judging.sweeping import sweep_command
    from quietfix.diagrams.pages.command import paged

    options: dict[str, Any] = {"estimators": estimators, "trials": trials, "seed": seed, "at": at, "set": settings}
    options |= {"scenario": scenario, "chunk": chunk, "threads": threads}
    with paged(report, out or resume):
        sweep_command(system, vary, options, out, overwrite, resume, workers, scheduler)


def verify(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Requirements, a YAML file.", show_default=False)],
    trials: Annotated[
        int | None, typer.Option(parser=whole, metavar="N", help="Trials at the last look, instead of the file's.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(parser=whole, metavar="N", help="Seed of all noise, instead of the file's.")
    ] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Write verification.json and a figure here.")] = None,
    chunk: Annotated[int | None, CHUNK] = None,
    threads: Annotated[int, THREADS] = 1,
    resume: Annotated[Path | None, AGAIN] = None,
    workers: Annotated[int | None, WORKERS] = None,
    scheduler: Annotated[str | None, SCHEDULER] = None,
    overwrite: Annotated[bool, OVERWRITE] = False,
    report: Annotated[bool, PAGE] = False,
) -> None:
    """Judge requirements: each holds, fails, or is undecided after as many trials as the file allows.

    Exit status: 0 all hold; 1 one fails; 3 none fails, but one is undecided; 2 a mistake in the file; 130 Ctrl-C.
    """
    from quietfix.diagrams.commands.judging.verifying import verify_command
    from quietfix.diagrams.pages.command import paged

    options = {"trials": trials, "seed": seed, "chunk": chunk, "threads": threads}
    with paged(report, out or resume):
        status = verify_command(file, out, overwrite, resume, workers, scheduler, **options)
    raise typer.Exit(status)
