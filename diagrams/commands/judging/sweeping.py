"""What ``quietfix sweep`` does: run, print a table, write a folder."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr

from quietfix.diagrams.console.answer import tell
from quietfix.diagrams.console.tables import print_table
from quietfix.diagrams.console.terminal import done, say
from quietfix.diagrams.experiments.sweep import Sweep, sweep_statistics
from quietfix.diagrams.scale.crew import Crew
from quietfix.diagrams.scale.resuming import begun_or_interrupted, earlier, keeping, say_left
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.output import Finished, OutputFolder
from quietfix.diagrams.studies.results import open_result
from quietfix.diagrams.tables.sweep import sweep_legend, sweep_table

__all__ = ["sweep_command"]


def sweep_command(
    system: str,
    vary: str,
    options: Mapping[str, Any],
    out: Path | None,
    overwrite: bool,
    resume: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> None:
    """Vary one number of a scenario; see ``quietfix sweep --help``."""
    began = time.monotonic()
    out = begun_or_interrupted(out, resume)
    with Crew(workers, scheduler, options.get("threads", 1)) as crew:
        planned = Sweep(system, vary, **options)
        if out is None:
            found = sweep_statistics(xr.concat(list(planned.points(crew.run)), "point", combine_attrs="override"))
            _print(found)
            return
        if resume is not None and _is_finished(out, planned):
            say(f"{out} is finished: nothing is left to run")
            tell(**json.loads((out / "sweep.json").read_text(encoding="utf-8")), folder=str(out))
            return
        try:
            found = _run_into(
                planned, OutputFolder(out, overwrite, "sweep", plan=planned.plan, resume=bool(resume)), crew
            )
        except Finished:
            return
    _print(found)
    tell(folder=str(out))
    done(f"wrote {out}: sweep.json, results.zarr, sweep.png ({time.monotonic() - began:.1f} s)")


def _print(found: dict[str, Any]) -> None:
    tell(**found)
    print_table(sweep_table(found))
    say(sweep_legend(found))


def _run_into(planned: Sweep, folder: OutputFolder, crew: Crew) -> dict[str, Any]:
    """Run what is left of a sweep, and write it."""
    from quietfix.diagrams.figures.shared.style import save
    from quietfix.diagrams.figures.sweep import draw_sweep

    with folder:
        say_left(folder)
        try:
            with keeping(folder):
                for number, sums, kept in planned.run(crew.run, folder.left):
                    folder.note(number, sums, kept)
        except (KeyboardInterrupt, UserError):
            if points := _points(planned, folder):
                _write(folder, points)
                print(f"quietfix: {len(points)} of {len(planned.vary.values)} points are whole", file=sys.stderr)
            raise
        found = _write(folder, _points(planned, folder))
        save(draw_sweep(found, planned.vary.geometric), folder.work / "sweep.png")
        folder.finish()
    return found


def _points(planned: Sweep, folder: OutputFolder) -> list[xr.Dataset]:
    """Return the points of which all chunks are finished, from the first one on."""
    assert folder.ledger is not None
    points: list[xr.Dataset] = []
    for point in range(len(planned.vary.values)):
        numbers = planned.numbers(point)
        if folder.left & set(numbers):
            break
        kept = [folder.ledger.kept(number) for number in numbers]
        points.append(planned.point(point, kept, [folder.ledger.sum_of(number) for number in numbers]))
    return points


def _is_finished(out: Path, planned: Sweep) -> bool:
    before = earlier(out)
    if before is None:
        return False
    before.refuse_other(planned.plan)
    if not before.finished or before.where != before.final:
        return False
    result = open_result(out)
    for name, was, now in (
        ("values", result["point"].values.tolist(), list(planned.vary.values)),
        ("at", result["at"].values.tolist(), planned.times),
    ):
        if was != now:
            raise UserError(f"--resume: {name}: {now} is not allowed; {out} has {was}")
    return True


def _write(folder: OutputFolder, points: Sequence[xr.Dataset]) -> dict[str, Any]:
    folder.put(points, "point")
    found = sweep_statistics(open_result(folder.store).load())
    text = json.dumps(found, indent=1, allow_nan=False) + "\n"
    (folder.work / "sweep.json").write_text(text, encoding="utf-8")
    return found
