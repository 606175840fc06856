"""Figure of the replay of bearings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray

from quietfix.diagrams.figures.shared.style import grid, new_figure
from quietfix.systems.fixes.von_mises import sample

__all__ = ["draw_fixes", "draw_lines"]

Array = NDArray[np.float64]

_MOST = 500  # lines; of more, a sample is drawn


def draw_lines(place: Array, azimuth: Array, weights: Array, fixes: Mapping[str, tuple[Array, bool]]) -> Figure:
    """Draw the lines of bearing, those with little weight dotted, and the fixes, those not to be believed crossed.

    Parameters
    ----------
    place : ndarray, shape (bearings, 2)
        Observers, east and north [m].
    azimuth, weights : ndarray, shape (bearings,)
        [rad], and the weight that the robust fix gives each.
    fixes : mapping of str to (ndarray, bool)
        Position [m] by method, and whether its own ellipse can be believed.
    """
    count = len(azimuth)
    rows = sample(count, _MOST)
    place, azimuth, weights = place[rows] / 1e3, azimuth[rows], weights[rows]
    middle = next((fixes[name][0] / 1e3 for name in ("robust", "ml", *fixes) if name in fixes), None)
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
    for name, (position, believable) in fixes.items():
        x = position / 1e3
        if middle is not None and np.linalg.norm(x - middle) < 3 * reach:
            axes.plot(*x, "o" if believable else "x", fillstyle="none", label=name if believable else f"{name} *")
    title = "" if fixes else "no fix: the lines do not cross ahead of the observers"
    if count > _MOST:
        title = f"{_MOST} of {count} lines" + f"; {title}" * bool(title)
    axes.set(xlabel="east [km]", ylabel="north [km]", aspect="equal", title=title)
    axes.autoscale_view()
    grid(axes)
    axes.legend()
    return figure


def draw_fixes(place: Array, tracks: Sequence[Array]) -> Figure:
    """Draw observers (k, 2) [m], and the places of each target (n, 2) [m], of one that moves its way."""
    figure, axes = new_figure()
    for track in tracks:
        axes.plot(*(track.T / 1e3), "o-", markersize=3, linewidth=0.8)
    axes.plot(*(place.T / 1e3), "k^", label="observers")
    title = "" if tracks else "no fix of any target"
    axes.set(xlabel="east [km]", ylabel="north [km]", aspect="equal", title=title)
    grid(axes)
    axes.legend()
    return figure
