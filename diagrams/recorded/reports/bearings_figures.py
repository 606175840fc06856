"""Figure of the replay of bearings."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from quietfix.diagrams.figures.shared.labels import name_places
from quietfix.diagrams.figures.shared.limits import reach
from quietfix.diagrams.figures.shared.style import COLOURS, grid, legend_beside, new_figure
from quietfix.diagrams.figures.shared.ticks import plain_ticks
from quietfix.systems.fixes.von_mises import sample

__all__ = ["draw_fixes", "draw_lines"]

Array = NDArray[np.float64]

_KM = 1e3
_NAMED = 40  # targets; the names of more would hide each other
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
        far = 3.0 * float(np.ptp(place, axis=0).max())
    else:
        far = 1.3 * float(np.linalg.norm(place - middle, axis=-1).max())
    ends = place + far * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    figure, axes = new_figure()
    lines = np.stack([place, ends], axis=1)
    for some, style in ((weights > 0.5, "-"), (weights <= 0.5, ":")):
        axes.add_collection(LineCollection(list(lines[some]), colors="0.6", linestyles=style, linewidths=0.8))
    axes.plot(*place.T, "k^", label="observers")
    for (name, (position, believable)), look in zip(fixes.items(), _looks(fixes), strict=True):
        x = position / 1e3
        label = name if believable else f"{name}, not to be believed"
        if middle is not None and np.linalg.norm(x - middle) < 3 * far:
            axes.plot(*x, "o" if believable else "x", fillstyle="none", color=look, mew=2, ms=9, label=label)
        else:
            axes.plot([], [], "o" if believable else "x", fillstyle="none", color=look, label=f"{label}: far off")
    title = "" if fixes else "no fix: the lines do not cross ahead of the observers"
    if count > _MOST:
        title = f"{_MOST} of {count} lines" + f"; {title}" * bool(title)
    axes.set(xlabel="east [km]", ylabel="north [km]", title=title)
    axes.set_aspect("equal", adjustable="datalim")
    axes.autoscale_view()
    plain_ticks(axes)
    grid(axes)
    legend_beside(axes)
    return figure


def _looks(names: Collection[str]) -> list[str]:
    return [COLOURS[i % len(COLOURS)] for i in range(len(names))]


def draw_fixes(place: Array, tracks: Mapping[str, tuple[Array, Array]], method: str = "") -> Figure:
    """Draw observers, and where targets are: of one that moves its way, a dot is where it begins.

    Parameters
    ----------
    place : ndarray, shape (observers, 2)
        East and north [m].
    tracks : mapping of str to (ndarray, ndarray)
        By target: its places (n, 2) [m], and the covariance (2, 2) of the last one [m^2].
    method : str
        How they were located.
    """
    figure, axes = new_figure(height=9.0)
    middle = np.median(place, axis=0) / _KM
    every = {name: positions / _KM for name, (positions, _) in tracks.items()}
    edge, out = _edge(place / _KM - middle, [positions - middle for positions in every.values()])
    # colours for as many as there are; more are told apart by their names alone
    several = len(tracks) > len(COLOURS)
    ends = {}
    for i, (name, positions) in enumerate(every.items()):
        color = COLOURS[0] if several else COLOURS[i]
        label = None if several else name
        axes.plot(*positions.T, "-", color=color, linewidth=1.6)
        axes.plot(*positions[0], "o", color=color, markersize=5, label=label)
        ellipse = _ellipse(positions[-1], tracks[name][1] / _KM**2)
        axes.add_artist(Line2D(*ellipse.T, color=color, linewidth=0.8))  # a long one does not set the axes
        beyond = np.abs(positions[-1] - middle).max()
        if edge is not None and beyond > edge:
            at = middle + (positions[-1] - middle) * edge / beyond
            axes.plot(*at, "D", markerfacecolor="none", color=color, markersize=8, clip_on=False, zorder=5)
        else:
            ends[name] = positions[-1]
    axes.plot(*(place.T / _KM), "k^", label="observers", markersize=8, zorder=4)
    by = f" by {method}" if method else ""
    words = f"{len(tracks)} targets{by}, with ellipses of two sigma" if tracks else "no fix of any target"
    words += f" ({out} beyond the edge, marked on it)" if out else ""
    axes.set(xlabel="east [km]", ylabel="north [km]", title=words)
    if edge is None:
        axes.set_aspect("equal", adjustable="datalim")
        axes.margins(0.1)
    else:
        axes.set(xlim=middle[0] + [-edge, edge], ylim=middle[1] + [-edge, edge], aspect="equal")
    plain_ticks(axes)
    grid(axes)
    legend_beside(axes)
    if several and len(ends) <= _NAMED:
        name_places(figure, axes, ends, COLOURS[0])
    return figure


def _edge(observers: Array, tracks: Sequence[Array]) -> tuple[float | None, int]:
    """Return where the axes end around the middle where targets lie far off, and how many lie beyond."""
    if not tracks:
        return None, 0
    lasts = np.stack([positions[-1] for positions in tracks])
    edge, _ = reach(lasts[:, None])
    if edge is None:
        return None, 0
    edge = max(edge, 1.2 * float(np.abs(observers).max()))
    return edge, int(np.count_nonzero(np.abs(lasts).max(axis=-1) > edge))


def _ellipse(middle: Array, covariance: Array) -> Array:
    """Return the ellipse (n, 2) of two standard deviations."""
    values, vectors = np.linalg.eigh(covariance)
    angle = np.linspace(0, 2 * np.pi, 100)
    ring = 2 * np.sqrt(np.maximum(values, 0)) * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(middle + ring @ vectors.T)
