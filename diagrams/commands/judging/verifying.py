"""What ``quietfix verify`` does: a table, ``verification.json``, a figure."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from quietfix.diagrams.console.tables import Column, Styled, Table, print_table
from quietfix.diagrams.figures.style import save
from quietfix.diagrams.figures.verification import VerdictRow, draw_verification
from quietfix.diagrams.statistics.sequential import FAILS, HOLDS, UNDECIDED, WORDS
from quietfix.diagrams.studies.output import OutputFolder
from quietfix.diagrams.verification.verify import Finding, Report, readable, verify

__all__ = ["print_report", "verification_figure", "verify_command"]

_STYLES = {HOLDS: "green", FAILS: "red", UNDECIDED: "yellow"}


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
    looks = ", ".join(map(str, report.looks))
    chances = sorted({f"{1 - (finding.requirement.confidence or 0):.2g}" for finding in report.findings})
    table = Table(
        _title(report),
        [
            *map(Column, ("requirement", "estimator", "metric")),
            *("estimate", "interval", Column("limit"), Column("verdict"), "trials"),
        ],
        caption=f"Looks at {looks} trials. A verdict is wrong with probability {' or '.join(chances)} at most, all"
        " looks together; the interval is that of the look that decided.",
    )
    for finding in report.findings:
        table.add(*_row(finding))
    print_table(table)
    counts = [sum(f.verdict == verdict for f in report.findings) for verdict in (HOLDS, FAILS, UNDECIDED)]
    print("{} of {} hold, {} fail, {} undecided".format(counts[0], len(report.findings), *counts[1:]))


def _row(finding: Finding) -> list[str | Styled]:
    asked, style = finding.requirement, _STYLES[finding.verdict]
    return [
        asked.name + (f" ({asked.case})" if asked.case else ""),
        asked.estimator,
        finding.metric,
        readable(finding.estimate),
        f"{readable(finding.lower)} to {readable(finding.upper)}",
        f"{finding.limit} {finding.unit}",
        Styled(WORDS[finding.verdict], style),
        str(finding.trials),
    ]
