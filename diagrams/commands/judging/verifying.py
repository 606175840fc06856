"""What ``quietfix verify`` does: a table, ``verification.json``, a figure."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from quietfix.diagrams.console.answer import tell
from quietfix.diagrams.console.tables import print_table
from quietfix.diagrams.console.terminal import done, say
from quietfix.diagrams.figures.shared.style import save
from quietfix.diagrams.figures.verification import VerdictRow, draw_verification
from quietfix.diagrams.scale.crew import Crew
from quietfix.diagrams.scale.resuming import begun_or_interrupted, keeping
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.marker import read_mark
from quietfix.diagrams.studies.output import Finished, OutputFolder
from quietfix.diagrams.tables.verification import verification_counts, verification_table
from quietfix.diagrams.verification.verify import Finding, Report, Verification

__all__ = ["print_report", "verification_figure", "verify_command"]


def verify_command(
    file: Path,
    out: Path | None,
    overwrite: bool,
    resume: Path | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    **options: Any,
) -> int:
    """Judge a requirements file, print a table and return the exit status; see ``quietfix verify --help``."""
    out = begun_or_interrupted(out, resume)
    if out is not None and resume is None:
        OutputFolder.check(out, overwrite)
    with Crew(workers, scheduler, options.get("threads", 1)) as crew:
        verification = Verification(file, **options, runner=crew.run)
        verification.build()
        if resume is not None and out is not None and (status := _finished(out, verification)) is not None:
            say(f"{out} is finished: nothing is left to run")
            tell(**json.loads((out / "verification.json").read_text(encoding="utf-8")), folder=str(out))
            return status
        if out is None:
            report = verification.report()
        else:
            try:
                report = _run_into(verification, out, overwrite, resume is not None)
            except Finished:
                return _finished(out, verification) or 0
    print_report(report)
    if out is not None:
        tell(folder=str(out))
        done(f"wrote {out}: verification.json, verification.png")
    return report.status


def _run_into(verification: Verification, out: Path, overwrite: bool, resume: bool) -> Report:
    """Judge what is left, and write all."""
    with OutputFolder(out, overwrite, "verify", plan=verification.plan, resume=resume) as folder:
        assert folder.ledger is not None
        if folder.chunks:
            say(f"{folder.chunks} chunk{'s are' if folder.chunks > 1 else ' is'} finished")
        ledger = folder.ledger
        verification.resume({n: (ledger.sum_of(n), ledger.kept(n)) for n in ledger.finished()}, folder.note)
        with keeping(folder):
            report = verification.report()
        (folder.work / "verification.json").write_text(report.as_json(), encoding="utf-8")
        save(verification_figure(report), folder.work / "verification.png")
        folder.finish()
    return report


def _finished(out: Path, verification: Verification) -> int | None:
    """Return the exit status of a finished run of the same requirements; None: it is not finished.

    Raises
    ------
    UserError
        Naming the field, if it is of others.
    """
    mark = None if out.is_symlink() else read_mark(out, "--resume")
    if mark is None or not mark.finished:
        return None
    try:
        found = json.loads((out / "verification.json").read_text(encoding="utf-8"))
        was = [found[name] for name in ("file", "system", "seed", "looks", "version")]
        limits = [(one["name"], one["at_least"], one["at_most"], one["confidence"]) for one in found["requirements"]]
        status = int(found["status"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise UserError(f"--resume: {out} is not allowed; it holds no verification") from error
    asked = verification.specification
    now = [verification.path.name, asked.system, verification.seed, list(verification.looks), verification.version]
    names = ["file", "system", "seed", "looks", "version", "requirements"]
    wanted = [(one.name, one.at_least, one.at_most, one.confidence) for one in asked.requirements]
    for name, before, after in zip(names, [*was, limits], [*now, wanted], strict=True):
        if before != after:
            raise UserError(f"--resume: {name}: {after} is not allowed; {out} has {before}")
    return status


def verification_figure(report: Report) -> Figure:
    """Return the figure of a report: every requirement against its limit."""
    return draw_verification([_drawn(finding) for finding in report.findings], _title(report))


def _drawn(finding: Finding) -> VerdictRow:
    asked = finding.requirement
    unit, case = f" {finding.unit}" if finding.unit else "", f" ({asked.case})" if asked.case else ""
    label = f"{asked.name}{case}\n{finding.limit}{unit}"
    numbers = finding.estimate, finding.lower, finding.upper
    return VerdictRow(label, asked.at_least, asked.at_most, *numbers, finding.verdict, finding.trials)


def _title(report: Report) -> str:
    return f"{report.path.name}: {report.specification.system}, seed {report.seed}"


def print_report(report: Report) -> None:
    """Print a table of a report: one row per requirement."""
    told = json.loads(report.as_json())
    tell(**told)
    print_table(verification_table(told))
    done(verification_counts(told))
