"""What ``quietfix compare`` does: run, print a table, write a folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from quietfix.diagrams.assembly.find import Found, find
from quietfix.diagrams.commands.judging.compared import Comparing, compared
from quietfix.diagrams.console.answer import asked_for_json, tell
from quietfix.diagrams.console.tables import print_table
from quietfix.diagrams.console.terminal import done, say
from quietfix.diagrams.experiments.candidates import Lineup
from quietfix.diagrams.experiments.compare import prepare
from quietfix.diagrams.experiments.compared_study import ComparedStudy
from quietfix.diagrams.experiments.comparison import check_at
from quietfix.diagrams.scale.asked import for_a_page
from quietfix.diagrams.scale.crew import Crew
from quietfix.diagrams.scale.resuming import begun_or_interrupted
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.diagrams.studies.recordings import with_data
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
    resume: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    report: bool = False,
) -> None:
    """Compare estimators on one or more systems; see ``quietfix compare --help``."""
    choose("format", format_, FORMATS)
    if format_ == "markdown" and asked_for_json():
        raise UserError("--format: markdown is not allowed with --json; one of them")
    out = begun_or_interrupted(out, resume)
    chosen_systems = [find(name) for name in systems]
    folders = _folders(chosen_systems, out)
    for path in folders.values():
        if path is not None and resume is None:
            OutputFolder.check(path, overwrite)
    with Crew(workers, scheduler, options.get("threads", 1)) as crew:
        # before anything runs: mistakes show early
        data, settings = options.get("data"), options.get("set")
        asked = {key: value for key, value in options.items() if key not in ("data", "set")}
        prepared = []
        for found in chosen_systems:
            prepared.append((found.title, *_prepared(found, asked | {"set": with_data(found, settings, data)}, report)))
        for _, study, _ in prepared:
            check_at(study, at)
        work = [Comparing(study, chosen, at, folders[name], overwrite, resume) for name, study, chosen in prepared]
        results = []
        for one in compared(work, crew):
            results.append(one.found if one.out is None else one.found | {"folder": str(one.out)})
            if format_ == "table" and not asked_for_json():
                print_table(comparison_table(one.found))
                for line in comparison_notes(one.found):
                    say(line)
                if one.out is not None and one.wrote:
                    done(f"wrote {one.out}: comparison.json, results.zarr, summary.json, figures")
    tell(comparisons=results)
    if format_ == "markdown" and not asked_for_json():
        print(comparison_markdown(results), end="")


def _prepared(found: Found, options: Mapping[str, Any], report: bool) -> tuple[ComparedStudy, Lineup]:
    """Return the study of a comparison, which keeps what a page needs where there is to be one, and who takes part."""
    if not report:
        return prepare(found, **options)
    lineups: list[Lineup] = []

    def make(keep: str) -> ComparedStudy:
        study, lineup = prepare(found, keep=keep, **options)
        lineups.append(lineup)
        return study

    return for_a_page(make), lineups[-1]


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
