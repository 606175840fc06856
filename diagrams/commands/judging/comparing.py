"""What ``quietfix compare`` does: run, print a table, write a folder."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from quietfix.diagrams.assembly.find import Found, find
from quietfix.diagrams.console.tables import print_table
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
from quietfix.diagrams.tables.comparison import comparison_markdown, comparison_notes, comparison_table

__all__ = ["FORMATS", "compare_command"]

FORMATS = ("table", "markdown")


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
            for line in comparison_notes(done[-1]):
                say(line)
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
