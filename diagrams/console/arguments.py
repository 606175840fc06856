"""Arguments and options that several commands have."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Annotated, Any

import typer

from quietfix.diagrams.console.answer import answering

__all__ = [
    "AGAIN",
    "CHUNK",
    "COMPARED",
    "DATA",
    "ESTIMATOR",
    "EVERY",
    "FIRST_TRIAL",
    "FROM",
    "JSON",
    "KEEP",
    "MEASUREMENTS",
    "OVERWRITE",
    "PAGE",
    "PLATFORMS",
    "RATE",
    "RECORDINGS",
    "RESULTS",
    "RESUME",
    "RUN_SEED",
    "SCENARIO",
    "SCHEDULER",
    "SEED",
    "SET",
    "SMOOTH",
    "SYSTEM",
    "THREADS",
    "TRIALS",
    "TRUST",
    "TRUTH",
    "TYPE",
    "VARY",
    "WORKERS",
    "WRITE_MEASUREMENTS",
    "number",
    "whole",
    "with_json",
    "with_smoothers",
]

SYSTEM = typer.Argument(
    metavar="SYSTEM[:VARIANT]",
    help="A name that `quietfix list` prints, package.module:OBJECT, FILE.py:OBJECT or FILE.yaml.",
    show_default=False,
)
SET = typer.Option("--set", metavar="KEY=VALUE", help="Change a field of the scenario; dotted key. Repeatable.")
SCENARIO = typer.Option("--scenario", metavar="FILE", help="A YAML file laid over the packaged scenario.")
DATA = typer.Option(
    "--data",
    metavar="DIR",
    help="Of a recording: its folder, or the one that holds it; else the variable QUIETFIX_DATA. Or its files, where "
    "it is in files of your own. Repeatable.",
)
ESTIMATOR = typer.Option(
    "--estimator",
    metavar="NAME",
    help="Run only these: names of the scenario or registry, `default` for all of the scenario, module:Class, or "
    "NAME_smoothed.",
)
SMOOTH = typer.Option(
    "--smooth",
    help="Beside each Kalman-type filter its smoother, NAME_smoothed: estimates with the later measurements too.",
)


MEASUREMENTS = typer.Option(
    metavar="FILE",
    help="Of a system of your own in YAML: what its sensors measured. CSV or Parquet with columns time or time_s, "
    "kind, receiver, reference, value, unit and, as needed, target, sigma.",
)
PLATFORMS = typer.Option(
    metavar="FILE",
    help="Of a system of your own in YAML: more platforms, a table with columns name, latitude_deg, longitude_deg, "
    "height_m (or x_m, y_m, z_m) and, of those that move, time or time_s. Of the recording iq: where receivers stand.",
)
RECORDINGS = typer.Argument(
    metavar="[FILE]",
    help="For `bearings`: a CSV file with columns time_s, x_m and y_m (or latitude_deg and longitude_deg), bearing_deg "
    "clockwise from north, sigma_deg (may be empty). For `iq`: two or more recordings, SigMF or WAV, or samples alone "
    "with --rate and --type.",
    show_default=False,
)
RATE = typer.Option("--rate", metavar="HZ", help="For `iq`: sample rate of files of samples alone.")
TYPE = typer.Option("--type", metavar="TYPE", help="For `iq`: their SigMF datatype.  [default: ci16_le]")
WRITE_MEASUREMENTS = typer.Option("--write-measurements", help="Write what was measured into DIR, for --measurements.")
TRUTH = typer.Option(metavar="FILE", help="With measurements: where the target was, a CSV track; errors are told then.")
OVERWRITE = typer.Option("--overwrite", help="Replace an earlier result in DIR.")
RESULTS = typer.Option(
    "--out", metavar="DIR", help="Write results, summary and figures here; a folder, or a URL of `run`."
)


def whole(value: str) -> int:
    """Return a whole number as a word on the command line says it."""
    try:
        return int(value)
    except ValueError:
        raise typer.BadParameter(f"{value} is not allowed; a whole number") from None


def number(value: str) -> float:
    """Return a number as a word on the command line says it."""
    try:
        return float(value)
    except ValueError:
        raise typer.BadParameter(f"{value} is not allowed; a number") from None


SEED = typer.Option(parser=whole, metavar="N", help="Seed of all noise.")
THREADS = typer.Option(parser=whole, metavar="N", help="Threads that share the trials; changes no number.")
TRIALS = typer.Option(parser=whole, metavar="N", help="Monte Carlo trials.  [default: 100; all tracks]")

# of `quietfix run`, where --from and --resume give them other defaults
FIRST_TRIAL = typer.Option(parser=whole, metavar="N", help="Number of the first trial.  [default: 0]")
RUN_SEED = typer.Option(parser=whole, metavar="N", help="Seed of all noise.  [default: 0]")
KEEP = typer.Option(help="estimates, covariance, measurements or all.  [default: estimates; with --report covariance]")
EVERY = typer.Option(parser=whole, metavar="N", help="Keep every so many epochs.  [default: 1]")
CHUNK = typer.Option(
    parser=whole, metavar="N", help="Trials at once; changes no trial's numbers, and sums over trials to rounding."
)
FROM = typer.Option("--from", metavar="RESULT", help="Run an earlier result again from itself.")
RESUME = typer.Option(
    "--resume",
    metavar="DIR",
    help="In place of --out: go on with the interrupted run of DIR, from its finished chunks in DIR.partial. What else "
    "is given must be what that run was asked for.",
)
AGAIN = typer.Option(
    "--resume",
    metavar="DIR",
    help="In place of --out, with all else as it was: go on with the interrupted run of DIR, from its finished chunks.",
)
TRUST = typer.Option("--trust", help="With --from or --resume: import the system and the classes that are named there.")
WORKERS = typer.Option(
    "--workers", parser=whole, metavar="N", help="Run chunks in N processes of this machine; the numbers are the same."
)
SCHEDULER = typer.Option(
    "--scheduler",
    metavar="tcp://HOST:PORT",
    help="Run chunks on the cluster of this `dask scheduler`; its workers need the same Quietfix, and your files.",
)
COMPARED = typer.Option(
    "--estimator",
    metavar="NAME",
    help="Names of the scenario or registry, package.module:Class, `default` or `all`.  [default: those of "
    "the scenario, and ekf, iekf, ukf, pf]",
)
JSON = typer.Option(
    "--json",
    help="Print one JSON object instead, with the numbers of the table unrounded: units in the names (_m, _s), null "
    "for what is unknown or infinite, sentences under notes.",
)
PAGE = typer.Option(
    "--report",
    help="With --out DIR: write DIR.html, too; see `quietfix report --help`. Without --keep covariances are kept "
    "for it, where the result stays below 1 GB.",
)
VARY = typer.Option(
    metavar="KEY=A:B:N",
    help="Field of the scenario and its values: from A to B in N points, KEY=log:A:B:N by a factor, or KEY=V1,V2,...",
    show_default=False,
)


def with_smoothers(estimators: list[str] | None, smooth: bool) -> list[str] | None:
    """Return the estimators that are asked for, with the smoothers of all of them where these are."""
    return [*(estimators or ["default"]), "smoothed"] if smooth else estimators


def with_json(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return a command that has the option ``--json``, too: what it tells is then printed as one JSON object."""

    @wraps(command)
    def told(*, as_json: bool = False, **options: Any) -> Any:
        ended = None
        with answering(as_json):
            try:
                command(**options)
            except typer.Exit as leaving:  # done, with a status of its own
                ended = leaving
        if ended is not None:
            raise ended

    signature = inspect.signature(command, eval_str=True)
    option = inspect.Parameter(
        "as_json", inspect.Parameter.KEYWORD_ONLY, default=False, annotation=Annotated[bool, JSON]
    )
    parameters = [one.replace(kind=inspect.Parameter.KEYWORD_ONLY) for one in signature.parameters.values()]
    told.__signature__ = signature.replace(parameters=[*parameters, option])  # type: ignore[attr-defined]
    told.__annotations__ = {one.name: one.annotation for one in (*parameters, option)}
    return told
