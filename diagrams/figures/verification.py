"""Requirements at a glance: each estimate with its interval against its limit."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from diagrams.figures.style import grid, new_figure

if TYPE_CHECKING:
    from diagrams.verification.verify import Finding, Report

__all__ = ["draw_verification"]

_LOOKS = {1: ("#0072b2", "o", "holds"), -1: ("#d55e00", "X", "fails"), 0: ("#e69f00", "D", "undecided")}
_END = 2.0  # in limits; what lies beyond is an arrow at the edge


def draw_verification(report: Report) -> Figure:
    """Draw every requirement in units of its limit: its upper one, or its lower one if it has no other.

    Parameters
    ----------
    report : Report
        From `diagrams.verification.verify.verify`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    count = len(report.findings)
    figure, axes = new_figure(height=2.0 + 0.5 * count)
    rows = [_scaled(finding) for finding in report.findings]
    start = min(0.0, *(1.1 * row[0] for row in rows if math.isfinite(row[0])), 0.0)
    for y, (finding, (low, high, estimate, lower, upper)) in enumerate(zip(report.findings, rows, strict=True)):
        colour, marker, _ = _LOOKS[finding.verdict]
        axes.barh(y, min(high, _END) - max(low, start), left=max(low, start), height=0.72, color="0.88", zorder=0)
        for edge in (low, high):
            if start < edge < _END:
                axes.plot([edge, edge], [y - 0.36, y + 0.36], color="0.3", linewidth=1.5, zorder=1)
        ends = np.clip([lower, upper], start, _END)
        axes.plot(ends, [y, y], color=colour, linewidth=3, solid_capstyle="butt", zorder=2)
        if start <= estimate <= _END:
            axes.plot(estimate, y, marker, color=colour, markersize=8, zorder=3, clip_on=False)
        for beyond, edge, tail in ((upper > _END, _END, _END - 0.1), (lower < start, start, start + 0.1)):
            if beyond:
                axes.annotate("", (edge, y), (tail, y), arrowprops={"arrowstyle": "->", "color": colour, "lw": 2})
    axes.set_yticks(range(count), [_label(finding) for finding in report.findings], fontsize=10)
    axes.set(
        xlim=(start, _END), ylim=(count - 0.4, -0.6), xlabel="metric divided by its limit (the upper one of a band)"
    )
    grid(axes)
    axes.grid(False, axis="y")
    right = axes.secondary_yaxis("right")
    right.set_yticks(range(count), [f"{f.word.partition(' ')[0]}, {f.trials}" for f in report.findings], fontsize=10)
    right.tick_params(length=0)
    seen = [verdict for verdict in _LOOKS if any(f.verdict == verdict for f in report.findings)]
    lines = [Line2D([], [], color=_LOOKS[v][0], marker=_LOOKS[v][1], linewidth=3, label=_LOOKS[v][2]) for v in seen]
    handles = [*lines, Patch(color="0.88", label="allowed")]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    figure.suptitle(
        f"{report.path.name}: {report.specification.system}, seed {report.seed}; verdict and trials at the right"
    )
    return figure


def _scaled(finding: Finding) -> tuple[float, float, float, float, float]:
    """Return lower and upper limit, estimate, lower and upper end of the interval, in units of a limit."""
    least, most = finding.requirement.at_least, finding.requirement.at_most
    unit = most if most else least if least else None
    scale = abs(unit) if unit else max(abs(finding.upper), 1e-12) if math.isfinite(finding.upper) else 1.0
    parts = (-math.inf if least is None else least, math.inf if most is None else most)
    low, high, *rest = (x / scale for x in (*parts, finding.estimate, finding.lower, finding.upper))
    return low, high, rest[0], rest[1], rest[2]


def _label(finding: Finding) -> str:
    unit = f" {finding.unit}" if finding.unit else ""
    case = f" ({finding.requirement.case})" if finding.requirement.case else ""
    return f"{finding.requirement.name}{case}\n{finding.limit}{unit}"
