"""Figure of the replay of bearings."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from quietfix.diagrams.figures.style import grid, new_figure
from quietfix.systems.fixes.von_mises import sample

if TYPE_CHECKING:
    from quietfix.diagrams.recorded.reports.bearings_report import BearingsReport

__all__ = ["draw_lines"]

_MOST = 500  # lines; of more, a sample is drawn


def draw_lines(result: BearingsReport) -> Figure:
    """Draw the lines of bearing, those with little weight dotted, and the fixes, those not to be believed crossed."""
    bearings, fixes = result.bearings, {name: fix for name, fix in result.fixes.items() if fix.there}
    count = len(bearings.azimuth)
    rows = sample(count, _MOST)
    place, azimuth, weights = bearings.place[rows] / 1e3, bearings.azimuth[rows], result.robust.weights[rows]
    middle = next((fixes[name].position / 1e3 for name in ("robust", "ml", *fixes) if name in fixes), None)
    if middle is None:
        reach = 3.0 * float(np.ptp(place, axis=0).max())
    else:
        reach = 1.3 * float(np.linalg.norm(place - middle, axis=-1).max())
    ends = place + reach * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    figure, axes = new_figure()
    lines = np.stack([place, ends], axis=1)
    for some, style in ((weights > 0.5, "-"), (weights <= 0.5, ":")):
        axes.add_collection(LineCollection(list(lines[some]), colors="0.6", linestyles=style, linewidths=0.8))
    axes.plot(*place.T, "k^", label="observers")
    for name, fix in fixes.items():
        x = fix.position / 1e3
        if middle is not None and np.linalg.norm(x - middle) < 3 * reach:
            axes.plot(
                *x, "o" if fix.believable else "x", fillstyle="none", label=name if fix.believable else f"{name} *"
            )
    title = "" if fixes else "no fix: the lines do not cross ahead of the observers"
    if count > _MOST:
        title = f"{_MOST} of {count} lines" + f"; {title}" * bool(title)
    axes.set(xlabel="east [km]", ylabel="north [km]", aspect="equal", title=title)
    axes.autoscale_view()
    grid(axes)
    axes.legend()
    return figure
