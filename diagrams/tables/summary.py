"""What a study tells: a table of its estimators, and the notes below."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from quietfix.diagrams.console.tables import Column, Table, lost, three_digits
from quietfix.diagrams.statistics.epochs import along, from_the_end
from quietfix.diagrams.statistics.lost import recovery_lines
from quietfix.diagrams.studies.starting import why_not_started

__all__ = ["end_of_each_track", "summary_notes", "summary_table"]


def summary_table(dataset: xr.Dataset, estimators: Mapping[str, Any]) -> Table:
    """Return the table of a study: one row per estimator."""
    tracks = along(dataset) == "epoch"
    if tracks:  # they have no time in common, but each has an end
        dataset, estimators = _counted_back(dataset)
    times = dataset["time"].values
    shares = (1.0,) if tracks else (1 / 15, 1 / 3, 2 / 3, 1.0)
    picks = sorted({int(np.argmin(np.abs(times - share * times[-1]))) for share in shares})
    variant = f":{dataset.attrs['variant']}" if dataset.attrs["variant"] else ""
    count = dataset.sizes["trial"]
    trials = f"{count} {'track' if tracks else 'trial'}{'s' * (count != 1)}"
    table = Table(
        f"{dataset.attrs['system']}{variant}, {trials}, seed {dataset.attrs['seed']}",
        [
            Column("estimator"),
            *("RMSE [m]" if tracks else f"{times[i]:g} s [m]" for i in picks),
            *("median [m]", "bound [m]", "height [m]", "velocity [m/s]", "NEES", "diverged"),
        ],
        caption="All at the last epoch of each track: RMSE, median and bound of position, RMSE of height and velocity, "
        "mean NEES"
        if tracks
        else "RMSE of position at each time; at the end: median and bound (filter's process noise) of position, "
        "RMSE of height and velocity, mean NEES",
    )
    for name, row in estimators.items():
        table.add(
            name if row.get("causal", True) else f"{name} (not causal)",
            *(three_digits(row["rmse_position_m"][i]) for i in picks),
            *(
                three_digits(_last(row, key))
                for key in ("median_position_m", "bound_position_m", "rmse_height_m", "rmse_velocity_mps", "nees_mean")
            ),
            lost(row["diverged"], row["not_started"], row.get("lost")),
        )
    return table


def _counted_back(dataset: xr.Dataset) -> tuple[xr.Dataset, dict[str, Any]]:
    """Return a result of tracks with epochs counted from their ends, and the numbers of it."""
    from quietfix.diagrams.statistics.metrics import summarise

    dataset = from_the_end(dataset)
    return dataset, summarise(dataset)


def end_of_each_track(dataset: xr.Dataset) -> dict[str, Any] | None:
    """Return by estimator the numbers at the last epoch of each track; None where all trials have the same epochs."""
    if along(dataset) != "epoch":
        return None
    _, estimators = _counted_back(dataset)
    return {
        name: {key: value[-1] if isinstance(value, list) and value else value for key, value in row.items()}
        for name, row in estimators.items()
    }


def summary_notes(dataset: xr.Dataset, estimators: Mapping[str, Any]) -> list[str]:
    """Return what a reader of the table must know, a line each."""
    lines = list(why_not_started(dataset, {name: row["not_started"] for name, row in estimators.items()}))
    lines += recovery_lines(estimators, dataset.sizes["trial"])
    return [*lines, str(dataset.attrs["note"])] if dataset.attrs.get("note") else lines


def _last(row: Mapping[str, Any], key: str) -> float | None:
    values = row.get(key)
    return values[-1] if values else None
