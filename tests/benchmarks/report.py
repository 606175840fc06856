"""Tables, on the terminal and as Markdown."""

from __future__ import annotations

import os
import platform
import statistics
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

__all__ = ["Section", "Threshold", "environment", "markdown", "microseconds", "spread", "text"]


@dataclass(frozen=True)
class Threshold:
    """What a ratio has to be.

    Parameters
    ----------
    value : float
        The bound.
    at_least : bool
        True: the ratio must not be smaller. False: it must not be larger.
    """

    value: float
    at_least: bool

    def __str__(self) -> str:
        """Return the bound with its sign."""
        return f"{'>=' if self.at_least else '<='} {self.value:g}"

    def met(self, ratio: float) -> bool:
        """Return whether `ratio` keeps the bound."""
        return ratio >= self.value if self.at_least else ratio <= self.value


@dataclass
class Section:
    """The table of one comparison.

    Attributes
    ----------
    title : str
        What is compared.
    columns : sequence of str
        Heads of the columns.
    rows : list of sequence of str
        The table.
    notes : list of str
        What a reader needs to judge the numbers: what is the same, what differs.
    judged : bool
        False where the sizes are too small for thresholds to mean anything.
    missed : int
        Thresholds that were not met.
    """

    title: str
    columns: Sequence[str]
    rows: list[Sequence[str]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    judged: bool = True
    missed: int = 0

    def judge(self, ratios: Sequence[float], threshold: Threshold) -> str:
        """Return the cell that says whether the median of `ratios` meets `threshold`, and count it if not."""
        if not self.judged:
            return "not judged"
        met = threshold.met(statistics.median(ratios))
        self.missed += not met
        return "met" if met else "NOT MET"


def microseconds(costs: Sequence[float]) -> str:
    """Return the median of costs in seconds, as microseconds, with the range over the rounds."""
    return spread([1e6 * cost for cost in costs])


def spread(values: Sequence[float]) -> str:
    """Return the median with the range over the rounds."""
    middle = statistics.median(values)
    return f"{_short(middle)} ({_short(min(values))} - {_short(max(values))})"


def _short(value: float) -> str:
    """Three significant digits, and no fewer than the whole part has."""
    whole = len(str(int(abs(value))))
    return f"{value:.{max(0, 3 - whole)}f}"


def environment(peers: Sequence[str] = ("stonesoup", "filterpy")) -> str:
    """Return machine and versions in one line."""
    versions = []
    for package in ("quietfix", "drake", "numpy", "scipy", *peers):
        try:
            versions.append(f"{package} {version(package)}")
        except PackageNotFoundError:
            versions.append(f"{package} not installed")
    return (
        f"{_processor()}, {os.cpu_count()} cores, {platform.system()}; one BLAS thread; "
        f"Python {platform.python_version()}, {', '.join(versions)}"
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.machine()


def text(section: Section) -> str:
    """Return a section for the terminal."""
    table = [section.columns, *section.rows]
    widths = [max(len(row[i]) for row in table) for i in range(len(section.columns))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in table]
    lines.insert(1, "  ".join("-" * width for width in widths))
    return "\n".join([section.title, "", *lines, "", *(f"- {note}" for note in section.notes)])


def markdown(section: Section) -> str:
    """Return a section as Markdown."""
    table = [section.columns, ["---"] * len(section.columns), *section.rows]
    lines = ["| " + " | ".join(row) + " |" for row in table]
    return "\n".join([f"**{section.title}**", "", *lines, "", *(f"- {note}" for note in section.notes)])
