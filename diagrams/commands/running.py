"""What the commands do; apart from the command line itself, so that ``--help`` needs neither Drake nor xarray."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

from quietfix.diagrams.assembly.find import FORMS, Found, find
from quietfix.diagrams.cloud.place import is_url
from quietfix.diagrams.commands.results.drawn import illustrate as _illustrate
from quietfix.diagrams.console.answer import asked_for_json, tell
from quietfix.diagrams.console.tables import print_table
from quietfix.diagrams.console.terminal import done, say
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.schema.origins import origins_of
from quietfix.diagrams.studies.output import Finished, OutputFolder
from quietfix.diagrams.studies.recordings import only_simulated, with_data, with_measurements, with_platforms
from quietfix.diagrams.studies.rerun import ask_again, ask_as
from quietfix.diagrams.studies.results import open_result, summary_of, write_summary
from quietfix.diagrams.tables.biases import bias_table
from quietfix.diagrams.tables.summary import end_of_each_track, summary_notes, summary_table

if TYPE_CHECKING:
    from quietfix.diagrams.assembly.recorded import Report
    from quietfix.diagrams.scale.resuming import Earlier
    from quietfix.diagrams.studies.study import Study
from quietfix.diagrams.writers.whole_file import written_beside

__all__ = ["draw_command", "gdop_command", "observe_command", "run_command"]


def run_command(
    system: str | None,
    asked: Mapping[str, Any],
    from_: Path | None,
    out: Path | None,
    overwrite: bool,
    trust: bool = False,
    progress: bool = True,
    resume: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
) -> Report | None:
    """Run a study, print its table and write its folder; return what a recording tells; see ``quietfix run --help``."""
    url = resume if is_url(resume) else out if is_url(out) else None
    if url is None:
        return _run(system, asked, from_, out, overwrite, trust, progress, resume, workers, scheduler)
    from quietfix.diagrams.cloud.mirrored import MirroredFolder, workplace

    option = "--out" if resume is None else "--resume"
    with workplace(url, option, overwrite, resume is not None) as (final, place):
        if resume is not None and system is None and not place.names():
            raise UserError(f"--resume: {place.url} is not allowed; there is nothing; name the system as well to begin")
        out, resume = (final, None) if resume is None else (out, final)
        folder = partial(MirroredFolder, place)
        return _run(system, asked, from_, out, False, trust, progress, resume, workers, scheduler, folder, place.url)


def _run(
    system: str | None,
    asked: Mapping[str, Any],
    from_: Path | None,
    out: Path | None,
    overwrite: bool,
    trust: bool,
    progress: bool,
    resume: Path | None,
    workers: int | None,
    scheduler: str | None,
    make: Callable[..., OutputFolder] = OutputFolder,
    shown: str | None = None,
) -> Report | None:
    """Run a study into a folder that `make` makes; `shown`: its name for the user."""
    from quietfix.diagrams.scale.asked import writes_itself
    from quietfix.diagrams.scale.crew import check_workers, parts_by
    from quietfix.diagrams.scale.resuming import ensemble_of, interrupted, joined, run_into
    from quietfix.diagrams.statistics.metrics import summarise

    began = time.monotonic()
    check_workers(workers, scheduler, asked.get("threads", 1))
    before = None if resume is None else interrupted(resume, system, out, from_)
    if resume is not None:
        out = resume if before is None else before.final
    study, write = _asked_for(system, asked, from_, out, trust, before)
    plan = study.plan(command="run", write_measurements=write)
    if before is not None:
        before.refuse_other(plan)
        if before.finished and before.where == before.final:
            _tell_finished(before.final)
            return None
    if out is None:
        every = range(plan.chunks)
        dataset = joined(study, parts_by(study, plan, every, progress, workers, scheduler))
        report, estimators = study.report(dataset), summarise(dataset)
        tell(**summary_of(dataset, estimators, began, None if report is None else report.summary()))
        _print_all(dataset, estimators, report, study.recorded is not None)
        return report
    try:
        folder = make(out, overwrite, "run", reads=from_, plan=plan, resume=resume is not None)
    except Finished:
        return None
    with folder:
        dataset = run_into(folder, study, parts_by(study, plan, folder.left, progress, workers, scheduler))
        known = ensemble_of(folder, dataset)
        estimators = summarise(dataset, known)
        report = study.report(dataset)
        told = None if report is None else report.summary()
        tell(**write_summary(folder.work / "summary.json", dataset, estimators, began, told))
        _illustrate(dataset, study, folder.work, known)
        if report is not None:
            report.draw(folder.work)
        if write and not writes_itself(study.found):
            _write_measured(dataset, study.request.scenario, folder.work)
        folder.finish()
    _print_all(open_result(folder.final), estimators, report, study.recorded is not None)
    seconds = f"{time.monotonic() - began:.1f} s"
    tell(folder=str(shown or out))
    done(f"wrote {shown or out}: results.zarr, summary.json, figures, diagram.svg{_others(out)} ({seconds})")
    return report


def _tell_finished(folder: Path) -> None:
    """Say that nothing is left to run, and with ``--json`` what the finished result says."""
    say(f"{folder} is finished: nothing is left to run")
    if asked_for_json():
        tell(**json.loads((folder / "summary.json").read_text(encoding="utf-8")), folder=str(folder))


def _others(folder: Path) -> str:
    """Return the tables in a folder, for the line that says what is written."""
    tables = [path.name for kind in ("estimates", "measurements", "truth") for path in folder.glob(f"{kind}[._]*")]
    return "".join(f", {name}" for name in sorted(tables))


def _write_measured(dataset: xr.Dataset, scenario: Any, folder: Path) -> None:
    """Write what was measured, and the truth, as tables, and as a message where the scenario has a date."""
    from quietfix.diagrams.own.writing import write_measurements, write_truth

    write_measurements(dataset, scenario, folder / "measurements.csv")
    write_truth(dataset, folder / "truth.csv")
    _write_message(scenario, folder)


def _write_message(scenario: Any, folder: Path) -> None:
    """Write the measurements of a scenario with a date as a Tracking Data Message, if it has any of them."""
    from quietfix.diagrams.own.messages import write_message

    if scenario.start_utc is None:
        return
    try:
        notes = write_message(folder / "measurements.csv", scenario, folder / "measurements.tdm")
    except UserError as error:  # what has been run is not lost for that
        notes = [f"not written: {error}"]
    for note in notes:
        say(f"measurements.tdm: {note}")


def _asked_for(
    system: str | None,
    asked: Mapping[str, Any],
    from_: Path | None,
    out: Path | None,
    trust: bool,
    before: Earlier | None = None,
) -> tuple[Study, bool]:
    """Return the study that a command line asks for, and whether its measurements are written."""
    from quietfix.diagrams.scale.asked import built, for_a_page

    options = dict(asked)
    fed = {key: options.pop(key, None) for key in ("measurements", "truth")}
    platforms = options.pop("platforms", None)
    write = options.pop("write_measurements", False)
    paged = options.pop("report", False) and "keep" not in options
    found: Found | str | None = system
    if before is not None and before.plan is not None:
        options.setdefault("chunk", before.plan.chunk)
        if paged:  # as it was begun
            options["keep"], paged = before.attributes["keep"], False
    if before is not None and system is None:
        found, options = ask_as(before.attributes, f"--resume: {before.where}", None, options, trust)
        write = write or bool(before.attributes.get("write_measurements"))
    elif from_ is not None:
        found, options = ask_again(from_, system, options, trust)
    elif trust:
        raise UserError("--trust: it needs --from RESULT or --resume DIR; what you name yourself is trusted")
    if found is None:
        raise UserError(f"system: it is missing; a name that `quietfix list` prints, --from RESULT, {FORMS}")
    if data := options.pop("data", None):
        found = find(found)
        options["set"] = with_data(found, options.get("set"), data)
    if platforms:
        found = find(found)
        options["set"] = with_platforms(found, options.get("set"), platforms)
    if fed["measurements"] or fed["truth"]:
        found = find(found)
        options["set"] = with_measurements(found, options.get("set"), **fed)
    if write:
        options = _to_be_written(options, out)
    if paged and from_ is None and not write:
        return for_a_page(lambda keep: built(found, {**options, "keep": keep}, False)), False
    return built(found, options, bool(write)), bool(write)


def _to_be_written(options: Mapping[str, Any], out: Path | None) -> dict[str, Any]:
    """Return options with which a study keeps what ``--write-measurements`` writes."""
    if out is None:
        raise UserError("--write-measurements: it needs --out DIR, where measurements.csv goes")
    if options.get("every", 1) != 1:
        raise UserError(f"--every: {options['every']} is not allowed with --write-measurements; 1")
    keep = {"estimates": "measurements", "covariance": "all"}
    kept = options.get("keep", "estimates")
    return {**options, "keep": keep.get(kept, kept)}


def _print_all(dataset: xr.Dataset, estimators: Mapping[str, Any], report: Report | None, recorded: bool) -> None:
    """Print the table of a study, where there is a truth to judge by, and that of a recording."""
    if recorded and report is None:
        say(f"every {dataset.attrs['every']}: what the recording tells of its own needs every epoch, and is left out")
    if not recorded or ("truth" in dataset and dataset["truth"].notnull().any()):
        print_summary(dataset, estimators)
    if report is not None:
        print_table(report.table())
        for line in report.notes():
            say(line)
        for further in getattr(report, "further", ()):
            _print_all(dataset, estimators, further, True)


def print_summary(dataset: xr.Dataset, estimators: Mapping[str, Any]) -> None:
    """Print a table of a study: one row per estimator."""
    if asked_for_json() and (ends := end_of_each_track(dataset)) is not None:
        tell(end_of_each_track=ends)
    print_table(summary_table(dataset, estimators))
    if (biases := bias_table(estimators)) is not None:
        print_table(biases)
    for line in summary_notes(dataset, estimators):
        say(line)


def draw_command(
    system: str,
    estimators: Sequence[str] | None,
    settings: Sequence[str] | None,
    scenario: Path | None,
    out: Path | None,
    data: Sequence[Path] | None = None,
) -> None:
    """Draw a block diagram; see ``quietfix draw --help``."""
    from quietfix.diagrams.assembly.drawing import draw, is_drawing
    from quietfix.diagrams.studies.study import Study

    found = find(system)
    path = out or Path(f"{found.slug}.svg")
    if path.suffix.lower() not in (".svg", ".png"):
        raise UserError(f"--out: {path} is not allowed; a file name that ends in .svg or .png")
    existed = path.exists()
    if existed and out is None and path.is_file() and not is_drawing(path):
        raise UserError(f"--out: {path} exists and was not drawn by this program; name it to replace it")
    settings = with_data(found, settings, data)
    with written_beside(path) as beside:
        study = Study(found, scenario=scenario, estimators=estimators, set=settings, trials=1)
        draw(study.picture, beside, system, study.probe.notes())
    tell(system=found.reference, variant=found.variant, file=str(path), replaced=existed)
    done(f"{'replaced' if existed else 'wrote'} {path}")


def gdop_command(
    system: str, settings: Sequence[str] | None, scenario: Path | None, out: Path | None, overwrite: bool
) -> None:
    """Map bounds; see ``quietfix gdop --help``."""
    from quietfix.diagrams.commands.mapping import map_figures

    found = find(system)
    resolved = found.system.load(found.variant, scenario, settings or [])
    only_simulated(found, "gdop", resolved)
    out = out or Path("gdop")
    with OutputFolder(out, overwrite, "gdop") as folder:
        with origins_of(resolved).placing(), found.blaming(resolved.estimators):
            map_figures(found.system, resolved, folder.work)
        folder.finish()
    tell(system=found.reference, variant=found.variant, folder=str(out))
    done(f"wrote {out}: figures")


def observe_command(
    system: str,
    estimators: Sequence[str] | None,
    window: float | None,
    settings: Sequence[str] | None,
    scenario: Path | None,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Say what is observable; see ``quietfix observe --help``."""
    from quietfix.diagrams.commands.observability_report import observability_summary, print_observability
    from quietfix.diagrams.experiments.observability import observe

    where = find(system)
    only_simulated(where, "observe", where.system.load(where.variant, scenario, settings or []))
    found = observe(where, estimators=estimators, window=window, scenario=scenario, set=settings)
    if out is not None:
        from quietfix.diagrams.figures.observability import observe_figures

        with OutputFolder(out, overwrite, "observe") as folder:
            summary = observability_summary(found, where)
            text = json.dumps(summary, indent=1, allow_nan=False) + "\n"
            (folder.work / "summary.json").write_text(text, encoding="utf-8")
            observe_figures(summary, system, folder.work)
            folder.finish()
    if asked_for_json():
        tell(**observability_summary(found, where))
    print_observability(found, system)
    if out is not None:
        tell(folder=str(out))
        done(f"wrote {out}: summary.json, figures")
