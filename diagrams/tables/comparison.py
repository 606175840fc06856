"""What a comparison tells: a table, the same in Markdown, and the notes below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from quietfix.diagrams.console.tables import Column, Styled, Table, lost, three_digits, with_interval

__all__ = ["comparison_markdown", "comparison_notes", "comparison_table"]

_BEST = "**"
_NOT_EFFICIENT = "†"


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
                lost(row["diverged"], row["not_started"], row.get("lost")),
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


def comparison_notes(found: Mapping[str, Any]) -> list[str]:
    """Return what a reader of the table must know, a line each."""
    lines = [_legend(found)]
    if found["feedback"]:
        lines.append(f"A prediction is fed back: {', '.join(found['feedback'])}.")
    for metric, words in (("rmse_position_m", "RMSE"), ("armse_position_m", "mean RMSE")):
        best = found["best"][metric]
        if best is None or best["runner_up"] is None or found["trials"] == 1:
            continue
        ratio = best["ratio"][best["runner_up"]]
        lines.append(
            f"{words}: {best['name']} is {'' if best['significant'] else 'not '}significantly the best; "
            f"{best['runner_up']} / {best['name']} = {_ratio(ratio['value'])} "
            f"({_ratio(ratio['low'])} to {_ratio(ratio['high'])})"
        )
    lines += found["not_started"]
    lines += found["recovery"]
    if found["note"]:
        lines.append(found["note"])
    lines += _lighter(found)
    lines += [f"left out: {name}: {reason}" for name, reason in found["left_out"].items()]
    return [*lines, f"{found['machine']}; {found['run_seconds']:.1f} s"]


def _lighter(found: Mapping[str, Any]) -> list[str]:
    return [
        f"{name}: added with " + ", ".join(f"{key} = {value}" for key, value in options.items())
        for name, options in found["lighter"].items()
    ]


def _ratio(value: float | None) -> str:
    return "infinite" if value is None else f"{value:.4g}"
