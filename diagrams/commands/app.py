"""The commands of ``quietfix``: what each takes; what it does is in a file of its own, imported when it is called."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import typer

from quietfix.diagrams.commands.judging.options import compare, sweep, verify
from quietfix.diagrams.commands.replay_help import ReplayHelp
from quietfix.diagrams.commands.results.options import diff, export, inspect, plot
from quietfix.diagrams.console.arguments import (
    AGAIN,
    CHUNK,
    DATA,
    ESTIMATOR,
    EVERY,
    FIRST_TRIAL,
    FROM,
    KEEP,
    MEASUREMENTS,
    OVERWRITE,
    PAGE,
    PLATFORMS,
    RATE,
    RECORDINGS,
    RESULTS,
    RESUME,
    RUN_SEED,
    SCENARIO,
    SCHEDULER,
    SET,
    SMOOTH,
    SYSTEM,
    THREADS,
    TRIALS,
    TRUST,
    TRUTH,
    TYPE,
    WORKERS,
    WRITE_MEASUREMENTS,
    number,
    with_json,
    with_smoothers,
)
from quietfix.diagrams.identification.options import identify
from quietfix.diagrams.pages.options import report as page
from quietfix.diagrams.scenes.options import play

__all__ = ["app"]

_EXIT = """Exit status: 0 done; 2 a mistake in what was asked for (one line says which field, its value and what is
allowed); 130 interrupted by Ctrl-C (finished chunks stay in DIR.partial). `verify`: 0 all requirements hold, 1 one
fails, 3 none fails but one is undecided."""

app = typer.Typer(
    name="quietfix",
    help="Passive location and tracking as Drake block diagrams.",
    epilog=_EXIT,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"quietfix {version('quietfix')}, drake {version('drake')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Print the version and exit.", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    """Hold the options that stand before a command."""


@app.command("list")
@with_json
def list_(
    chosen: Annotated[
        list[str] | None, typer.Argument(metavar="[SYSTEM]...", help="Only these.", show_default=False)
    ] = None,
) -> None:
    """List systems, variants and estimators."""
    from quietfix.diagrams.commands.listing import list_systems

    list_systems(chosen)


@app.command()
@with_json
def new(
    name: Annotated[str, typer.Argument(metavar="NAME", help="What it is called; letters, digits, _ and -.")],
    template: Annotated[
        str | None, typer.Option(metavar="NAME", help="drone, ship or beacon.  [default: drone]", show_default=False)
    ] = None,
    python: Annotated[bool, typer.Option("--python", help="Write a Python module, NAME.py, instead.")] = False,
) -> None:
    """Write a system of your own to start from, NAME.yaml, and its requirements, NAME.requirements.yaml."""
    from quietfix.diagrams.commands.new import new_command

    new_command(name, template, python)


@app.command()
@with_json
def show(
    system: Annotated[str | None, SYSTEM] = None,
    settings: Annotated[list[str] | None, SET] = None,
    scenario: Annotated[Path | None, SCENARIO] = None,
    schema: Annotated[bool, typer.Option("--schema", help="Print the JSON Schema of its file instead.")] = False,
) -> None:
    """Print the resolved scenario with a comment on every field, to be edited and used with --scenario.

    With --schema, for an editor that completes and checks the file; without SYSTEM that of a system of one's own.
    """
    from quietfix.diagrams.commands.catalogue import load_scenario, meanings, scenario_data
    from quietfix.diagrams.console.answer import asked_for_json, tell
    from quietfix.diagrams.schema.errors import UserError
    from quietfix.diagrams.schema.scenario import dump

    if schema:
        from quietfix.diagrams.commands.json_schema import schema_text

        if settings or scenario is not None:
            raise UserError("--schema: it is not allowed with --set or --scenario; it is the same for all values")
        text = schema_text(system)
        tell(**json.loads(text))
        if not asked_for_json():
            print(text)
        return
    if system is None:
        raise UserError("SYSTEM: none is given; see `quietfix list`")
    resolved = load_scenario(system, None, scenario, settings or [])
    if asked_for_json():
        tell(system=system, scenario=scenario_data(resolved), meanings=meanings(resolved))
        return
    print(f"# {system}")
    print(dump(resolved), end="")


@app.command()
@with_json
def run(
    system: Annotated[str | None, SYSTEM] = None,
    estimators: Annotated[list[str] | None, ESTIMATOR] = None,
    trials: Annotated[int | None, TRIALS] = None,
    first_trial: Annotated[int | None, FIRST_TRIAL] = None,
    seed: Annotated[int | None, RUN_SEED] = None,
    settings: Annotated[list[str] | None, SET] = None,
    scenario: Annotated[Path | None, SCENARIO] = None,
    from_: Annotated[Path | None, FROM] = None,
    keep: Annotated[str | None, KEEP] = None,
    every: Annotated[int | None, EVERY] = None,
    chunk: Annotated[int | None, CHUNK] = None,
    threads: Annotated[int, THREADS] = 1,
    out: Annotated[Path | None, RESULTS] = None,
    resume: Annotated[Path | None, RESUME] = None,
    workers: Annotated[int | None, WORKERS] = None,
    scheduler: Annotated[str | None, SCHEDULER] = None,
    overwrite: Annotated[bool, OVERWRITE] = False,
    trust: Annotated[bool, TRUST] = False,
    data: Annotated[list[Path] | None, DATA] = None,
    measurements: Annotated[Path | None, MEASUREMENTS] = None,
    truth: Annotated[Path | None, TRUTH] = None,
    platforms: Annotated[Path | None, PLATFORMS] = None,
    write_measurements: Annotated[bool, WRITE_MEASUREMENTS] = False,
    smooth: Annotated[bool, SMOOTH] = False,
    report: Annotated[bool, PAGE] = False,
) -> None:
    """Run a study: print a table; with --out write results.zarr, summary.json, figures and diagram.svg.

    On measurements of your own also estimates.csv and estimates.parquet.
    """
    from quietfix.diagrams.commands.running import run_command
    from quietfix.diagrams.pages.command import paged

    asked = {
        "estimators": with_smoothers(estimators, smooth),
        "trials": trials,
        "first_trial": first_trial,
        "seed": seed,
        "set": settings,
        "scenario": scenario,
        "keep": keep,
        "every": every,
        "chunk": chunk,
        "threads": threads,
        "data": data,
        "measurements": measurements,
        "truth": truth,
        "platforms": platforms,
        "write_measurements": write_measurements or None,
        "report": report or None,
    }
    given = {k: v for k, v in asked.items() if v is not None}
    with paged(report, out or resume):
        run_command(system, given, from_, out, overwrite, trust, True, resume, workers, scheduler)


@app.command()
def live(
    system: Annotated[str, SYSTEM],
    stdin: Annotated[
        str | None, typer.Argument(metavar="[-]", help="Standard input; the default.", show_default=False)
    ] = None,
    udp: Annotated[
        str | None, typer.Option("--udp", metavar="HOST:PORT", help="Lines in datagrams to this address.")
    ] = None,
    follow: Annotated[
        Path | None, typer.Option("--follow", metavar="FILE", help="Lines of a file, and those that are added.")
    ] = None,
    state: Annotated[
        Path | None, typer.Option("--state", metavar="FILE", help="Go on from here, and keep here what is known.")
    ] = None,
    lag: Annotated[
        float, typer.Option("--lag", parser=number, metavar="S", help="Rows may come so late; estimates are revised.")
    ] = 0.0,
    wait: Annotated[
        float, typer.Option("--wait", parser=number, metavar="S", help="An instant's rows wait so long for others.")
    ] = 0.5,
    jump: Annotated[
        float,
        typer.Option("--jump", parser=number, metavar="S", help="A row further ahead than this waits for another one."),
    ] = 3600.0,
    platforms: Annotated[Path | None, PLATFORMS] = None,
    estimators: Annotated[list[str] | None, ESTIMATOR] = None,
    settings: Annotated[list[str] | None, SET] = None,
    scenario: Annotated[Path | None, SCENARIO] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="As ever: what is printed are JSON objects, one a line.")
    ] = False,
) -> None:
    """Run estimators on measurements as they come: lines of JSON in, estimates as lines of JSON out.

    Lines have the columns of --measurements of `quietfix run`. What is wrong in them is left out, counted and told.
    """
    from quietfix.diagrams.live.command import Asked, live_command

    asked = Asked(stdin, udp, follow, state, wait, lag, jump)
    live_command(system, asked, estimators, settings, scenario, platforms)


@app.command()
@with_json
def draw(
    system: Annotated[str, SYSTEM],
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="SVG or PNG.  [default: SYSTEM.svg]")] = None,
    estimators: Annotated[list[str] | None, ESTIMATOR] = None,
    settings: Annotated[list[str] | None, SET] = None,
    scenario: Annotated[Path | None, SCENARIO] = None,
    data: Annotated[list[Path] | None, DATA] = None,
) -> None:
    """Draw the block diagram as SVG or PNG."""
    from quietfix.diagrams.commands.running import draw_command

    draw_command(system, estimators, settings, scenario, out, data)


@app.command()
@with_json
def gdop(
    system: Annotated[str, SYSTEM],
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Where the maps go.  [default: gdop]")] = None,
    settings: Annotated[list[str] | None, SET] = None,
    scenario: Annotated[Path | None, SCENARIO] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace earlier maps in DIR.")] = False,
) -> None:
    """Map the bound over where the target may be, and print how large it is."""
    from quietfix.diagrams.commands.running import gdop_command

    gdop_command(system, settings, scenario, out, overwrite)


@app.command()
@with_json
def observe(
    system: Annotated[str, SYSTEM],
    estimators: Annotated[list[str] | None, ESTIMATOR] = None,
    window: Annotated[
        float | None,
        typer.Option(
            "--window", parser=number, metavar="S", help="Seconds from the first epoch on.  [default: the whole run]"
        ),
    ] = None,
    settings: Annotated[list[str] | None, SET] = None,
    scenario: Annotated[Path | None, SCENARIO] = None,
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="Write summary.json and figures here.")] = None,
    overwrite: Annotated[bool, OVERWRITE] = False,
) -> None:
    """Say which directions of the state at the start the measurements can know, how well, and from when on."""
    from quietfix.diagrams.commands.running import observe_command

    observe_command(system, estimators, window, settings, scenario, out, overwrite)


@app.command(cls=ReplayHelp)
@with_json
def replay(
    dataset: Annotated[str, typer.Argument(metavar="DATASET", help="Which recording; see `quietfix list`.")],
    file: Annotated[list[Path] | None, RECORDINGS] = None,
    data: Annotated[
        Path | None,
        typer.Option("--data", metavar="DIR", help="Folder of the recordings; else the variable QUIETFIX_DATA."),
    ] = None,
    estimators: Annotated[list[str] | None, ESTIMATOR] = None,
    out: Annotated[Path | None, RESULTS] = None,
    overwrite: Annotated[bool, OVERWRITE] = False,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Change a setting; `quietfix show DATASET` prints them, and so does `quietfix replay DATASET --help`.",
        ),
    ] = None,
    platforms: Annotated[Path | None, PLATFORMS] = None,
    write_measurements: Annotated[bool, WRITE_MEASUREMENTS] = False,
    resume: Annotated[Path | None, AGAIN] = None,
    rate: Annotated[str | None, RATE] = None,
    type_: Annotated[str | None, TYPE] = None,
    smooth: Annotated[bool, SMOOTH] = False,
    report: Annotated[bool, PAGE] = False,
) -> None:
    """Run a recording: `quietfix run DATASET` in fewer words."""
    from quietfix.diagrams.commands.replay import replay as run_recording
    from quietfix.diagrams.pages.command import paged

    raw = [f"raw.{key}={value}" for key, value in (("rate_hz", rate), ("type", type_)) if value is not None]
    chosen, smoothed = [*raw, *(settings or ())], with_smoothers(estimators, smooth)
    with paged(report, out or resume):
        run_recording(
            dataset, data, out, True, file, chosen, smoothed, overwrite, platforms, write_measurements, resume, report
        )


_FURTHER: list[Callable[..., Any]] = [
    *(with_json(one) for one in (compare, sweep, verify, identify, inspect, plot, page)),
    play,
    *(with_json(one) for one in (diff, export)),
]
for command in _FURTHER:
    app.command()(command)
for registered in app.registered_commands:  # else a list of commands clips what each does
    lines = (registered.callback.__doc__ or "").strip().partition("\n\n")[0] if registered.callback else ""
    registered.short_help = " ".join(lines.split())
