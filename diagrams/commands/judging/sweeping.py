"""What ``quietfix sweep`` does: run, print a table, write a folder."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from quietfix.diagrams.console.tables import Column, Table, lost, print_table, three_digits, with_interval
from quietfix.diagrams.console.terminal import say
from quietfix.diagrams.experiments.sweep import Sweep, sweep_statistics
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.diagrams.studies.results import open_result

__all__ = ["sweep_command", "sweep_table"]


def sweep_command(system: str, vary: str, options: Mapping[str, Any], out: Path | None, overwrite: bool) -> None:
    """Vary one number of a scenario; see ``quietfix sweep --help``."""
    began = time.monotonic()
    planned = Sweep(system, vary, **options)
    if out is None:
        found = sweep_statistics(xr.concat(list(planned.points(True)), "point", combine_attrs="override"))
        print_table(sweep_table(found))
        say(_legend(found))
        return
    from quietfix.diagrams.figures.style import save
    from quietfix.diagrams.figures.sweep import draw_sweep

    with OutputFolder(out, overwrite, "sweep") as folder:
        try:
            for point in planned.points(progress=True):
                folder.append(point, "point")
        except KeyboardInterrupt:
            if folder.chunks:
                _write(folder)
                done, of = folder.chunks, len(planned.vary.values)
                print(f"quietfix: {done} of {of} points are kept in {folder.partial}", file=sys.stderr)
            raise
        found = _write(folder)
        save(draw_sweep(found, planned.vary.geometric), folder.work / "sweep.png")
        folder.finish()
    print_table(sweep_table(found))
    say(_legend(found))
    print(f"wrote {out}: sweep.json, results.zarr, sweep.png ({time.monotonic() - began:.1f} s)")


def _write(folder: OutputFolder) -> dict[str, Any]:
    found = sweep_statistics(open_result(folder.store).load())
    text = json.dumps(found, indent=1, allow_nan=False) + "\n"
    (folder.work / "sweep.json").write_text(text, encoding="utf-8")
    return found


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


def _legend(found: Mapping[str, Any]) -> str:
    times = sorted(set(found["time_s"]))
    when = f"{times[0]:g} s" if len(times) == 1 else f"{times[0]:g} to {times[-1]:g} s"
    percent = f"{100 * found['confidence']:g} %"
    return (
        f"Errors at {when}; the same noise at every point. In brackets: pointwise {percent} intervals, bootstrapped "
        f"over the trials (the ratio to the first point: paired). †: the truth does not move as the filter believes, "
        f"so RMSE/bound is no efficiency. NEES/n: 1 is consistent; low, high: outside the {percent} band."
    )
