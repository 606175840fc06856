"""What ``quietfix inspect`` does: a table of trials, or the course of one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from quietfix.diagrams.commands.results.opened import Opened, chosen, opened, reading
from quietfix.diagrams.commands.results.trials import course_of, ends_of, of_a_sweep, told_of
from quietfix.diagrams.console.answer import asked_for_json, tell
from quietfix.diagrams.console.tables import Column, Table, lost, print_table, three_digits
from quietfix.diagrams.console.terminal import say
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.json_numbers import json_numbers

__all__ = ["inspect_command"]

_EPOCHS = 12  # rows of a course; --json has all


def inspect_command(path: Path, worst: int, trial: int | None, estimators: Sequence[str] | None) -> None:
    """Show trials of a result; see ``quietfix inspect --help``."""
    if worst < 1:
        raise UserError(f"--worst: {worst} is not allowed; a whole number >= 1")
    result = opened(path, "inspect")
    names = chosen(result, estimators)
    place = None if trial is None else _place(result, trial)
    with reading(path, "inspect"):
        if result.sweeps:
            found = _sweep(result, names, worst, place)
        else:
            found = _worst(result, names, worst) if place is None else _course(result, names, place)
    tell(**_head(result), **found)
    if asked_for_json():  # states and reasons are in the rows
        return
    print_table(_table(result, found) if place is None or result.sweeps else _course_table(result, found))
    for line in _reasons(found):
        say(line)


def _head(result: Opened) -> dict[str, Any]:
    """Return which result it is."""
    attributes = result.dataset.attrs
    return {
        "schema_version": int(attributes["schema_version"]),
        "result": str(result.path),
        "command": result.kind,
        "system": attributes["system"],
        "variant": attributes["variant"] or None,
        "seed": int(attributes["seed"]),
        "trials": int(result.dataset.sizes["trial"]),
        "version": attributes["version"],
    }


def _place(result: Opened, trial: int) -> int:
    numbers = result.dataset["trial"].values
    where = np.flatnonzero(numbers == trial)
    if not where.size:
        raise UserError(f"--trial: {trial} is not allowed; {result.path} has {numbers.min()} to {numbers.max()}")
    return int(where[0])


# ------------------------------------------------------------------------------------------------- numbers


def _worst(result: Opened, names: list[str], count: int) -> dict[str, Any]:
    """Return the worst trials of each estimator, and how many are lost."""
    estimators = {}
    for name, ends in ends_of(result.dataset, names).items():
        at_end, ever = ends.flagged
        estimators[name] = {
            "rmse_position_m": json_numbers(ends.rmse),
            "median_position_m": json_numbers(ends.median),
            "diverged": int(ends.lost.sum()),
            "not_started": int(ends.never.sum()),
            "lost": at_end,
            "ever_lost": ever,
            "trials": [told_of(result.dataset, name, place) for place in ends.worst(count)],
        }
    return {"estimators": estimators}


def _course(result: Opened, names: list[str], place: int) -> dict[str, Any]:
    """Return one trial of each estimator, with its course."""
    estimators = {}
    for name in names:
        one = result.dataset.isel(trial=[place]).sel(estimator=[name]).load()
        course = {key: json_numbers(values) for key, values in course_of(one).items()}
        estimators[name] = told_of(result.dataset, name, place) | {"course": course}
    return {"estimators": estimators}


def _sweep(result: Opened, names: list[str], count: int, place: int | None) -> dict[str, Any]:
    """Return of each estimator and point the worst trials, or the one that is asked for."""
    numbers = result.dataset["trial"].values
    estimators: dict[str, Any] = {}
    for name in names:
        points = []
        for value, ends in of_a_sweep(result.dataset, name):
            rows = [
                {
                    "trial": int(numbers[k]),
                    "position_error_m": json_numbers(ends.error[k]),
                    "nees_per_state": json_numbers(ends.nees[k]),
                    "state": "never started" if ends.never[k] else "lost" if ends.lost[k] else "kept",
                }
                for k in (ends.worst(count) if place is None else [place])
            ]
            summary = {"rmse_position_m": json_numbers(ends.rmse), "median_position_m": json_numbers(ends.median)}
            counts = {"diverged": int(ends.lost.sum()), "not_started": int(ends.never.sum())}
            points.append({"value": value, **summary, **counts, "trials": rows})
        estimators[name] = {"points": points}
    return {"key": result.dataset.attrs["key"], "estimators": estimators}


# -------------------------------------------------------------------------------------------------- tables


def _table(result: Opened, found: Mapping[str, Any]) -> Table:
    if result.sweeps:
        return _sweep_table(result, found)
    what = "track" if "track" in result.dataset.coords else "trial"
    titles = ("error [m]", "largest [m]", "at [s]", "NEES/n", "NIS/row")
    table = Table(
        f"{result.title}: the worst {what}s of each estimator",
        [Column("estimator"), Column(what) if what == "track" else what, *titles, Column("state")],
        keys=2,
        caption=f"Position error and NEES/n (1 is consistent) at the last epoch of the {what}, the largest error "
        "and when that was, NIS over all epochs by the rows used (1 is consistent); flagged: the estimator itself "
        "calls it lost at the end. " + ". ".join(_counted(name, row) for name, row in found["estimators"].items()),
    )
    for name, row in found["estimators"].items():
        for one in row["trials"]:
            state = f"{one['state']}, flagged" if one["flagged"] else one["state"]
            table.add(name, str(one.get("track", one["trial"])), *_cells(one), state)
    return table


def _counted(name: str, row: Mapping[str, Any]) -> str:
    rmse, median = three_digits(row["rmse_position_m"]), three_digits(row["median_position_m"])
    counts = lost(row["diverged"], row["not_started"], row["lost"])
    return f"{name}: RMSE {rmse} m, median {median} m, diverged {counts}"


def _cells(one: Mapping[str, Any]) -> list[str]:
    keys = ("position_error_m", "largest_error_m", "largest_at_s", "nees_per_state", "nis_per_row")
    return [three_digits(one[key]) for key in keys]


def _sweep_table(result: Opened, found: Mapping[str, Any]) -> Table:
    key = found["key"].rpartition(".")[2]
    table = Table(
        f"{result.title}, {found['key']} varied",
        [Column("estimator"), key, "trial", "error [m]", "NEES/n", Column("state"), "RMSE [m]", "diverged"],
        keys=3,
        caption="Position error and NEES/n (1 is consistent) of the trial; RMSE and diverged of all.",
    )
    for name, row in found["estimators"].items():
        for point in row["points"]:
            for one in point["trials"]:
                numbers = three_digits(one["position_error_m"]), three_digits(one["nees_per_state"])
                counts = lost(point["diverged"], point["not_started"])
                of_all = three_digits(point["rmse_position_m"]), counts
                table.add(name, f"{point['value']:g}", str(one["trial"]), *numbers, one["state"], *of_all)
    return table


def _course_table(result: Opened, found: Mapping[str, Any]) -> Table:
    first = next(iter(found["estimators"].values()))
    named = {
        "position_error_m": "error [m]",
        "height_error_m": "height [m]",
        "velocity_error_mps": "velocity [m/s]",
        "nees_per_state": "NEES/n",
        "nis": "NIS",
        "nis_dof": "rows",
        "lost": "flagged",
    }
    shown = [key for key in named if key in first["course"]]
    name = first.get("track", first["trial"])
    table = Table(
        f"{result.title}: {'track' if 'track' in first else 'trial'} {name}",
        [Column("estimator"), "time [s]", *(named[key] for key in shown)],
        keys=2,
        caption=f"At most {_EPOCHS} epochs of each; all are in --json. Errors of position, height and velocity; "
        "rows: how many were used; flagged: 1 where the estimator itself calls it lost.",
    )
    for name, row in found["estimators"].items():
        course = row["course"]
        count = len(course["time_s"])
        for k in sorted({int(k) for k in np.linspace(0, count - 1, min(_EPOCHS, count)).round()}):
            table.add(name, f"{course['time_s'][k]:g}", *(three_digits(course[key][k]) for key in shown))
    return table


def _reasons(found: Mapping[str, Any]) -> list[str]:
    """Return a line for each trial that is lost or never started."""
    lines = []
    for name, row in found["estimators"].items():
        for one in row.get("trials", [row] if "why" in row else []):
            which = one.get("track") or f"trial {one['trial']}"
            if one["why"] is not None:
                lines.append(f"{name}, {which}: {one['state']}: {one['why']}")
            if one["flagged_from_s"] is not None:
                end = "" if one["flagged"] else ", and no more at the end"
                lines.append(f"{name}, {which}: flagged by the estimator from {one['flagged_from_s']:g} s on{end}")
    return lines
