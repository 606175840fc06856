"""Requirements at a glance: each estimate with its interval against its limit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from quietfix.diagrams.figures.shared.style import grid, new_figure

__all__ = ["VerdictRow", "draw_verification"]

_LOOKS = {1: ("#0072b2", "o", "holds"), -1: ("#d55e00", "X", "fails"), 0: ("#e69f00", "D", "undecided")}
_END = 2.0  # in limits; what lies beyond is an arrow at the edge


@dataclass(frozen=True)
class VerdictRow:
    """One requirement on the figure.

    Attributes
    ----------
    label : str
        Name, and the limit in words.
    at_least, at_most : float or None
        The limits.
    estimate, lower, upper : float
        The metric and its interval.
    verdict : int
        1 holds, -1 fails, 0 undecided.
    trials : int
        How many were used.
    """

    label: str
    at_least: float | None
    at_most: float | None
    estimate: float
    lower: float
    upper: float
    verdict: int
    trials: int


def draw_verification(findings: Sequence[VerdictRow], title: str) -> Figure:
    """Draw every requirement in units of its limit: its upper one, or its lower one if it has no other.

    Parameters
    ----------
    findings : sequence of VerdictRow
        From the top down.
    title : str
        File, system and seed.

    Returns
    -------
    matplotlib.figure.Figure
    """
    count = len(findings)
    figure, axes = new_figure(height=2.0 + 0.5 * count)
    rows = [_scaled(finding) for finding in findings]
    start = min(0.0, *(1.1 * row[0] for row in rows if math.isfinite(row[0])), 0.0)
    for y, (finding, (low, high, estimate, lower, upper)) in enumerate(zip(findings, rows, strict=True)):
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
    axes.set_yticks(range(count), [finding.label for finding in findings], fontsize=10)
    axes.set(
        xlim=(start, _END), ylim=(count - 0.4, -0.6), xlabel="metric divided by its limit (the upper one of a band)"
    )
    grid(axes)
    axes.grid(False, axis="y")
    right = axes.secondary_yaxis("right")
    right.set_yticks(range(count), [f"{_LOOKS[f.verdict][2]}, {f.trials}" for f in findings], fontsize=10)
    right.tick_params(length=0)
    seen = [verdict for verdict in _LOOKS if any(f.verdict == verdict for f in findings)]
    lines = [Line2D([], [], color=_LOOKS[v][0], marker=_LOOKS[v][1], linewidth=3, label=_LOOKS[v][2]) for v in seen]
    handles = [*lines, Patch(color="0.88", label="allowed")]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    figure.suptitle(f"{title}; verdict and trials at the right")
    return figure


def _scaled(finding: VerdictRow) -> tuple[float, float, float, float, float]:
    """Return lower and upper limit, estimate, lower and upper end of the interval, in units of a limit."""
    least, most = finding.at_least, finding.at_most
    unit = most if most else least if least else None
    scale = abs(unit) if unit else max(abs(finding.upper), 1e-12) if math.isfinite(finding.upper) else 1.0
    parts = (-math.inf if least is None else least, math.inf if most is None else most)
    low, high, *rest = (x / scale for x in (*parts, finding.estimate, finding.lower, finding.upper))
    return low, high, rest[0], rest[1], rest[2]
