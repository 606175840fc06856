"""What ``quietfix sweep`` does: run, print a table, write a folder."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import xarray as xr

from quietfix.diagrams.console.tables import print_table
from quietfix.diagrams.console.terminal import say
from quietfix.diagrams.experiments.sweep import Sweep, sweep_statistics
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.diagrams.studies.results import open_result
from quietfix.diagrams.tables.sweep import sweep_legend, sweep_table

__all__ = ["sweep_command"]


def sweep_command(system: str, vary: str, options: Mapping[str, Any], out: Path | None, overwrite: bool) -> None:
    """Vary one number of a scenario; see ``quietfix sweep --help``."""
    began = time.monotonic()
    planned = Sweep(system, vary, **options)
    if out is None:
        found = sweep_statistics(xr.concat(list(planned.points(True)), "point", combine_attrs="override"))
        print_table(sweep_table(found))
        say(sweep_legend(found))
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
    say(sweep_legend(found))
    print(f"wrote {out}: sweep.json, results.zarr, sweep.png ({time.monotonic() - began:.1f} s)")


def _write(folder: OutputFolder) -> dict[str, Any]:
    found = sweep_statistics(open_result(folder.store).load())
    text = json.dumps(found, indent=1, allow_nan=False) + "\n"
    (folder.work / "sweep.json").write_text(text, encoding="utf-8")
    return found
