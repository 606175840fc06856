"""What ``quietfix diff`` does: two results beside each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from quietfix.diagrams.chunks.plan import differences
from quietfix.diagrams.commands.results.asked import asked_lines
from quietfix.diagrams.commands.results.difference import MANY, compared
from quietfix.diagrams.commands.results.opened import Opened, chosen, opened, reading
from quietfix.diagrams.commands.results.trials import Ends, ends_of, of_a_sweep
from quietfix.diagrams.console.answer import asked_for_json, tell
from quietfix.diagrams.console.tables import Column, Styled, Table, lost, print_table, three_digits, with_interval
from quietfix.diagrams.console.terminal import say
from quietfix.diagrams.experiments.summary_entries import nearest_epoch
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.epochs import along

__all__ = ["diff_command"]

_CONFIDENCE = 0.95
_APART = ("schema_version", "note", "trials", "chunk")  # attributes that are said elsewhere, or of no interest


def diff_command(a: Path, b: Path, at: float | None, estimators: Sequence[str] | None) -> None:
    """Compare two results; see ``quietfix diff --help``."""
    first, second = opened(a, "diff"), opened(b, "diff")
    if first.sweeps != second.sweeps:
        raise UserError(f"diff: {a} and {b} are not alike: one is a sweep")
    if first.sweeps and first.dataset.attrs["key"] != second.dataset.attrs["key"]:
        keys = [one.dataset.attrs["key"] for one in (first, second)]
        raise UserError(f"diff: {a} varies {keys[0]} and {b} {keys[1]}; two sweeps of the same field")
    pairs = _pairs(first, second, estimators)
    with reading(a, "diff"), reading(b, "diff"):
        places, why_not = _paired(first, second)
        found = _found(first, second, pairs, at, places)
    told = {
        "a": str(first.path),
        "b": str(second.path),
        "paired": places is not None,
        "why_not_paired": why_not,
        "trials_in_common": None if places is None else int(places[0].size),
        "confidence": _CONFIDENCE,
        "asked": [{"field": key, "a": was, "b": now} for key, was, now in _asked(first, second)],
        **found,
    }
    tell(**told)
    if asked_for_json():
        return
    print_table(_table(first, second, told))
    for line in _notes(told, asked_lines(_asked_of(first, second), _asked_of(second, first))):
        say(line)


def _pairs(first: Opened, second: Opened, estimators: Sequence[str] | None) -> list[tuple[str, str]]:
    """Return which estimator is held against which: those of the same name, or the only one of each."""
    if estimators:
        chosen(second, estimators)
        return [(name, name) for name in chosen(first, estimators)]
    names, others = chosen(first, None), chosen(second, None)
    both = [(name, name) for name in names if name in others]
    if both:
        return both
    if len(names) == len(others) == 1:
        return [(names[0], others[0])]
    raise UserError(
        f"diff: no estimator is in both: {first.path} has {', '.join(names)}, {second.path} {', '.join(others)}"
    )


def _paired(first: Opened, second: Opened) -> tuple[tuple[Any, Any] | None, str | None]:
    """Return the places of the trials that both have, or why they do not share their noise."""
    for key in ("system", "seed"):
        was, now = (one.dataset.attrs.get(key) for one in (first, second))
        if was != now:
            return None, f"the {key} is {was} in A and {now} in B"
    numbers, mine, its = np.intersect1d(first.dataset["trial"], second.dataset["trial"], return_indices=True)
    if numbers.size < 2:
        return None, "they have fewer than two trials in common"
    if "track" in first.dataset.coords and "track" in second.dataset.coords:
        tracks = [one.dataset["track"].values[k] for one, k in ((first, mine), (second, its))]
        if list(tracks[0]) != list(tracks[1]):
            return None, "their tracks are not the same ones"
    return (mine, its), None


def _found(
    first: Opened, second: Opened, pairs: list[tuple[str, str]], at: float | None, places: tuple[Any, Any] | None
) -> dict[str, Any]:
    """Return the numbers: of each estimator, of a sweep of each of its points."""
    if first.sweeps:
        if at is not None:
            raise UserError(f"--at: {at:g} is not allowed for sweeps, which have one time")
        rows: dict[str, Any] = {}
        for a, b in pairs:
            its = dict(of_a_sweep(second.dataset, b))
            points = [(value, ends, its[value]) for value, ends in of_a_sweep(first.dataset, a) if value in its]
            rows[_named(a, b)] = [{"value": value, **_one(x, y, places)} for value, x, y in points]
        if not all(rows.values()):
            raise UserError("diff: the two sweeps have no value of the field in common")
        return {"key": first.dataset.attrs["key"], "estimators": rows}
    (one, when_a), (other, when_b) = _until(first, at), _until(second, at)
    ends_a, ends_b = ends_of(one, [a for a, _ in pairs]), ends_of(other, [b for _, b in pairs])
    rows = {_named(a, b): _one(ends_a[a], ends_b[b], places) for a, b in pairs}
    return {"time_a_s": when_a, "time_b_s": when_b, "estimators": rows}


def _named(a: str, b: str) -> str:
    return a if a == b else f"{a}, {b}"


def _one(a: Ends, b: Ends, places: tuple[Any, Any] | None) -> dict[str, Any]:
    if places is None:
        return compared(a, b, False, _CONFIDENCE)
    mine, its = (one.of(k) for one, k in zip((a, b), places, strict=True))
    return compared(mine, its, True, _CONFIDENCE)


def _until(result: Opened, at: float | None) -> tuple[xr.Dataset, float | None]:
    """Return a result that ends at a time, and when that is; None: its tracks have no time in common."""
    dataset = result.dataset
    if along(dataset) == "epoch":
        if at is not None:
            raise UserError(f"--at: {at:g} is not allowed; the tracks of {result.path} have no time in common")
        return dataset, None
    times = np.asarray(dataset["time"].values, dtype=float)
    place = nearest_epoch(times, at)
    return dataset.isel(time=slice(place + 1)), float(times[place])


def _asked_of(result: Opened, other: Opened) -> dict[str, Any]:
    """Return what was asked for, of what the two can differ in."""
    found = {key: value for key, value in result.dataset.attrs.items() if key not in _APART}
    both = [one.dataset.attrs for one in (result, other)]
    own = all(one.get("system_source") == "yaml" for one in both)
    if both[0].get("system") != both[1].get("system") and not own:  # their scenarios have other fields
        found.pop("scenario", None)
    return found


def _asked(first: Opened, second: Opened) -> list[tuple[str, str, str]]:
    """Return the fields in which what was asked for differs."""
    was, now = _asked_of(first, second), _asked_of(second, first)
    found = list(differences(was, now))
    within = any(key not in was and key not in now for key, _, _ in found)  # of the scenario, by their dotted keys
    return [one for one in found if not (within and one[0] == "scenario")]


# ------------------------------------------------------------------------------------------------------ table


def _table(first: Opened, second: Opened, told: Mapping[str, Any]) -> Table:
    keys = [told["key"].rpartition(".")[2]] if "key" in told else []
    titles = ("RMSE A [m]", "RMSE B [m]", "B/A", *(["B closer"] if told["paired"] else []))
    titles += ("median A [m]", "median B [m]", "NEES/n A", "NEES/n B", "diverged A", "diverged B")
    table = Table(
        f"A: {told['a']}: {first.title}; B: {told['b']}: {second.title}",
        [Column("estimator"), *keys, *titles],
        keys=1 + len(keys),
    )
    for name, rows in told["estimators"].items():
        for row in rows if keys else [rows]:
            value = [f"{row['value']:g}"] if keys else []
            table.add(name, *value, *_cells(row, told["paired"]))
    return table


def _cells(row: Mapping[str, Any], paired: bool) -> list[str | Styled]:
    ratio = row["ratio"]
    shown: str | Styled = with_interval(ratio)
    if ratio["low"] is not None and ratio["high"] is not None and not ratio["low"] <= 1 <= ratio["high"]:
        shown = Styled(f"* {shown}", "bold")
    cells: list[str | Styled] = [with_interval(row["rmse_a_m"]), with_interval(row["rmse_b_m"]), shown]
    if paired:
        cells.append("same" if row["b_closer"] is None else _percent(row["b_closer"]))
    cells += [three_digits(row["median_a_m"]), three_digits(row["median_b_m"])]
    cells += [three_digits(row["nees_a"]["value"]), three_digits(row["nees_b"]["value"])]
    return [*cells, *(lost(row[f"diverged_{which}"], row[f"not_started_{which}"]) for which in "ab")]


def _percent(share: Mapping[str, float]) -> str:
    return f"{100 * share['value']:.3g} % ({100 * share['low']:.3g}-{100 * share['high']:.3g})"


def _notes(told: Mapping[str, Any], asked: Sequence[str]) -> list[str]:
    """Return what a reader of the table must know, with what was asked for differently."""
    rows = [one for row in told["estimators"].values() for one in (row if isinstance(row, list) else [row])]
    if told["paired"]:
        how = f"Paired: {told['trials_in_common']} trials have the same noise in both."
        closer = " B closer: in which share of the trials that differ B has the smaller error."
    else:
        how, closer = f"Not paired: {told['why_not_paired']}; each result counts for itself.", ""
    most = max(max(row["trials_a"], row["trials_b"]) for row in rows)
    by = "normal distribution, for there are many trials" if most > MANY else "bootstrap over the trials"
    when = ""
    if told.get("time_a_s") is not None:
        same = told["time_a_s"] == told["time_b_s"]
        when = f" Errors at {told['time_a_s']:g} s" + ("." if same else f" in A, at {told['time_b_s']:g} s in B.")
    lines = [
        f"{how}{when} In brackets: {100 * told['confidence']:g} % intervals ({by}); *: B/A is not 1 by chance, each "
        f"ratio for itself.{closer} NEES/n: 1 is consistent."
    ]
    lines += [f"asked: {line}" for line in asked]
    same = [name for name, row in told["estimators"].items() if not isinstance(row, list) and row.get("identical")]
    if same:
        lines.append(f"the same errors to the last bit: {', '.join(same)}")
    return lines
