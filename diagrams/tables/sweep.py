"""What a sweep tells: a table, and what is to be known of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from quietfix.diagrams.console.tables import Column, Table, lost, three_digits, with_interval

__all__ = ["sweep_legend", "sweep_table"]


def sweep_table(found: Mapping[str, Any]) -> Table:
    """Return the table of a sweep, as `quietfix.diagrams.experiments.sweep.sweep_statistics` gives it."""
    name = found["system"] + (f":{found['variant']}" if found["variant"] else "")
    last = found["key"].rpartition(".")[2]
    titles = (last, "RMSE [m]", "times the first", "RMSE/bound", "NEES/n", "verdict", "diverged")
    table = Table(
        f"{name}, {found['key']} varied, {found['trials']} trials, seed {found['seed']}",
        [Column("estimator"), *titles],
        keys=2,
    )
    for name, row in found["estimators"].items():
        for k, value in enumerate(found["values"]):
            table.add(
                name,
                f"{value:g}",
                with_interval(row["rmse_position_m"][k]),
                "1" if k == 0 else with_interval(row["rmse_ratio"][k]),
                three_digits(row["efficiency"][k]["value"]) + ("" if row["efficiency_means_something"][k] else "†"),
                with_interval(row["nees_per_state"][k]),
                row["nees_verdict"][k] or "-",
                lost(row["diverged"][k], row["not_started"][k]),
            )
    return table


def sweep_legend(found: Mapping[str, Any]) -> str:
    """Return what a reader of the table must know."""
    times = sorted(set(found["time_s"]))
    when = f"{times[0]:g} s" if len(times) == 1 else f"{times[0]:g} to {times[-1]:g} s"
    percent = f"{100 * found['confidence']:g} %"
    return (
        f"Errors at {when}; the same noise at every point. In brackets: pointwise {percent} intervals, bootstrapped "
        f"over the trials (the ratio to the first point: paired). †: the truth does not move as the filter believes, "
        f"so RMSE/bound is no efficiency. NEES/n: 1 is consistent; low, high: outside the {percent} band."
    )
