"""What ``quietfix verify`` does: a table, ``verification.json``, a figure."""

from __future__ import annotations

import json
from pathlib import Path

from matplotlib.figure import Figure

from quietfix.diagrams.console.tables import print_table
from quietfix.diagrams.figures.style import save
from quietfix.diagrams.figures.verification import VerdictRow, draw_verification
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.diagrams.tables.verification import verification_counts, verification_table
from quietfix.diagrams.verification.verify import Finding, Report, verify

__all__ = ["print_report", "verification_figure", "verify_command"]


def verify_command(
    file: Path, trials: int | None, seed: int | None, out: Path | None, overwrite: bool, threads: int = 1
) -> int:
    """Judge a requirements file, print a table and return the exit status; see ``quietfix verify --help``."""
    if out is None:
        report = verify(file, trials=trials, seed=seed, progress=True, threads=threads)
        print_report(report)
        return report.status
    with OutputFolder(out, overwrite, "verify") as folder:
        report = verify(file, trials=trials, seed=seed, progress=True, threads=threads)
        (folder.work / "verification.json").write_text(report.as_json(), encoding="utf-8")
        save(verification_figure(report), folder.work / "verification.png")
        folder.finish()
    print_report(report)
    print(f"wrote {out}: verification.json, verification.png")
    return report.status


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
    print_table(verification_table(told))
    print(verification_counts(told))
