"""What ``quietfix compare`` does: run, print a table, write a folder."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from quietfix.diagrams.assembly.find import Found, find
from quietfix.diagrams.console.tables import Column, Styled, Table, lost, print_table, three_digits, with_interval
from quietfix.diagrams.console.terminal import say
from quietfix.diagrams.experiments.candidates import Lineup
from quietfix.diagrams.experiments.compare import prepare
from quietfix.diagrams.experiments.compared_study import ComparedStudy
from quietfix.diagrams.experiments.comparison import check_at, comparison_statistics
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.diagrams.studies.recordings import with_data
from quietfix.diagrams.studies.results import open_result, write_summary
from quietfix.diagrams.studies.whole import join

__all__ = ["FORMATS", "compare_command", "comparison_markdown", "comparison_table"]

FORMATS = ("table", "markdown")
_BEST = "**"
_NOT_EFFICIENT = "†"


def compare_command(
    systems: Sequence[str],
    options: Mapping[str, Any],
    at: float | None,
    format_: str,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Compare estimators on one or more systems; see ``quietfix compare --help``."""
    choose("format", format_, FORMATS)
    chosen_systems = [find(name) for name in systems]
    folders = _folders(chosen_systems, out)
    for path in folders.values():
        if path is not None:
            OutputFolder.check(path, overwrite)
    # before anything runs: mistakes show early
    data, settings = options.get("data"), options.get("set")
    asked = {key: value for key, value in options.items() if key not in ("data", "set")}
    prepared = [
        (found.title, *prepare(found, set=with_data(found, settings, data), **asked)) for found in chosen_systems
    ]
    for _, study, _ in prepared:
        check_at(study, at)
    done = []
    for name, study, chosen in prepared:
        folder = folders[name]
        done.append(_one(study, chosen, at, folder, overwrite))
        if format_ == "table":
            print_table(comparison_table(done[-1]))
            print_notes(done[-1])
            if folder is not None:
                print(f"wrote {folder}: comparison.json, results.zarr, summary.json, figures")
    if format_ == "markdown":
        print(comparison_markdown(done), end="")


def _folders(systems: Sequence[Found], out: Path | None) -> dict[str, Path | None]:
    """Return where the comparison of each system goes, by its title."""
    folders: dict[str, Path | None] = {}
    for found in systems:
        if found.title in folders:
            raise UserError(f"SYSTEM: {found.title} is not allowed; it is given twice")
        path = out if out is None or len(systems) == 1 else out / found.slug
        if path is not None and path in folders.values():
            raise UserError(f"SYSTEM: {found.title} is not allowed with --out; another one is called {found.slug}, too")
        folders[found.title] = path
    return folders


def _one(study: ComparedStudy, chosen: Lineup, at: float | None, out: Path | None, overwrite: bool) -> dict[str, Any]:
    began = time.monotonic()
    if out is None:
        found = comparison_statistics(join(list(study.chunks(progress=True))), study, chosen, at=at)
        return found | {"run_seconds": round(time.monotonic() - began, 3)}
    from quietfix.diagrams.figures import study_figures
    from quietfix.diagrams.figures.comparison import draw_comparison
    from quietfix.diagrams.figures.style import save
    from quietfix.diagrams.statistics.metrics import summarise

    with OutputFolder(out, overwrite, "compare") as folder:
        try:
            for chunk in study.chunks(progress=True):
                folder.append(chunk)
        except KeyboardInterrupt:
            if folder.chunks:
                kept = open_result(folder.store).sizes["trial"]
                print(
                    f"quietfix: {kept} of {study.request.trials} trials are kept in {folder.partial}", file=sys.stderr
                )
            raise
        dataset = open_result(folder.store).load()
        found = comparison_statistics(dataset, study, chosen, at=at)
        found["run_seconds"] = round(time.monotonic() - began, 3)
        text = json.dumps(found, indent=1, allow_nan=False) + "\n"
        (folder.work / "comparison.json").write_text(text, encoding="utf-8")
        write_summary(folder.work / "summary.json", dataset, summarise(dataset), began)
        save(draw_comparison(found), folder.work / "comparison.png")
        study_figures(dataset, folder.work)
        folder.finish()
    return found


# ----------------------------------------------------------------------------------------------------- tables


def comparison_table(found: Mapping[str, Any]) -> Table:
    """Return the table of one comparison, as `quietfix.diagrams.experiments.compare.comparison_statistics` gives it."""
    name = _named(found)
    titles = (
        f"RMSE at {time_words(found)} [m]",
        "mean RMSE [m]",
        "median [m]",
        "RMSE/bound",
        "NEES/n",
        "diverged",
        "us",
    )
    table = Table(f"{name}, {_drawn(found)}", [Column("estimator"), *titles])
    for row in _rows(found):
        table.add(*(_starred(cell) for cell in row))
    return table


def _starred(cell: str) -> str | Styled:
    return Styled(f"* {cell.strip('*')}", "bold") if cell.startswith(_BEST) else cell


def comparison_markdown(found: Sequence[Mapping[str, Any]]) -> str:
    """Return one Markdown table of several comparisons, and the notes that belong to it."""
    titles: tuple[str, ...] = ("estimator", "RMSE at the end [m]", "mean RMSE over time [m]", "median at the end [m]")
    titles += ("RMSE/bound", "NEES/n", "diverged", "us per step")
    lines = ["| " + " | ".join(titles) + " |", "|" + "---|" * len(titles)]
    for one in found:
        name = _named(one)
        lines.append(f"| **{name}**, {time_words(one)} |" + " |" * (len(titles) - 1))
        named = (f"`{row[0]}`".replace(" (not causal)`", "` (not causal)") for row in _rows(one))
        lines += [f"| {n} | " + " | ".join(row[1:]) + " |" for n, row in zip(named, _rows(one), strict=True)]
    first = found[0]
    seconds = ", ".join(f"{_named(one)} {one['run_seconds']:.0f} s" for one in found)
    extra = [f"{_named(one)}: {line}." for one in found for line in _lighter(one)]
    extra += [f"{_named(one)}: left out: {n}: {why}." for one in found for n, why in one["left_out"].items()]
    facts = f"{_drawn(first)}; {first['machine']}; {seconds}."
    lines += ["", f"{facts} {_legend(first)}", *extra]
    return "\n".join(lines) + "\n"


def _drawn(found: Mapping[str, Any]) -> str:
    return f"{found['trials']} trial{'s' * (found['trials'] != 1)}, seed {found['seed']}"


def _named(found: Mapping[str, Any]) -> str:
    return found["system"] + (f":{found['variant']}" if found["variant"] else "")


def time_words(found: Mapping[str, Any]) -> str:
    """Return when the errors of a comparison are taken."""
    return "the end of each track" if found["time_s"] is None else f"{found['time_s']:g} s"


def _rows(found: Mapping[str, Any]) -> list[tuple[str, ...]]:
    rows = []
    for name, row in found["estimators"].items():
        cells = []
        for metric in ("rmse_position_m", "armse_position_m"):
            best = found["best"][metric]
            cell = with_interval(row[metric])
            cells.append(f"{_BEST}{cell}{_BEST}" if best and best["significant"] and best["name"] == name else cell)
        efficiency = three_digits(row["efficiency"]["value"])
        if efficiency != "-" and not row["efficiency_means_something"]:
            efficiency += _NOT_EFFICIENT
        verdict = row["nees_verdict"]
        nees = three_digits(row["nees_per_state"]["value"])
        if nees == "-" and verdict == "high":
            nees = "infinite:"
        shown = name if row["causal"] else f"{name} (not causal)"
        rows.append(
            (
                shown,
                *cells,
                three_digits(row["median_position_m"]),
                efficiency,
                nees if verdict in (None, "in band") else f"{nees} {verdict}",
                lost(row["diverged"], row["not_started"]),
                three_digits(row["cost_us"]),
            )
        )
    return rows


def _legend(found: Mapping[str, Any]) -> str:
    percent = f"{100 * found['confidence']:g} %"
    if found["trials"] == 1:
        return (
            "One track of a recording: how far chance moves these numbers is not known, and nobody is significantly "
            f"the best. {_NOT_EFFICIENT}: the truth does not move as the filter believes, so this is no efficiency. "
            "us: processor time of the estimator's own mathematics per step."
        )
    return (
        f"In brackets: {percent} intervals (paired bootstrap over the trials). Bold or *: smallest, and significantly "
        f"so against every other causal one ({found['correction']}, {percent} together). {_NOT_EFFICIENT}: the truth "
        f"does not move as the filter believes, so this is no efficiency. NEES/n: 1 is consistent; low, high: outside "
        f"the {percent} band. us: processor time of the estimator's own mathematics per step and trial, "
        f"{found['batch']} trials at once."
    )


def print_notes(found: Mapping[str, Any]) -> None:
    """Print what a reader of the table must know."""
    say(_legend(found))
    if found["feedback"]:
        say(f"A prediction is fed back: {', '.join(found['feedback'])}.")
    for metric, words in (("rmse_position_m", "RMSE"), ("armse_position_m", "mean RMSE")):
        best = found["best"][metric]
        if best is None or best["runner_up"] is None or found["trials"] == 1:
            continue
        ratio = best["ratio"][best["runner_up"]]
        say(
            f"{words}: {best['name']} is {'' if best['significant'] else 'not '}significantly the best; "
            f"{best['runner_up']} / {best['name']} = {_ratio(ratio['value'])} "
            f"({_ratio(ratio['low'])} to {_ratio(ratio['high'])})"
        )
    for line in found["not_started"]:
        say(line)
    if found["note"]:
        say(found["note"])
    for line in _lighter(found):
        say(line)
    for name, reason in found["left_out"].items():
        say(f"left out: {name}: {reason}")
    say(f"{found['machine']}; {found['run_seconds']:.1f} s")


def _lighter(found: Mapping[str, Any]) -> list[str]:
    return [
        f"{name}: added with " + ", ".join(f"{key} = {value}" for key, value in options.items())
        for name, options in found["lighter"].items()
    ]


def _ratio(value: float | None) -> str:
    return "infinite" if value is None else f"{value:.4g}"
