"""Names beside places on a figure, where they hide neither each other nor what is drawn."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

__all__ = ["name_places"]

Array = NDArray[np.float64]

_SAME = 4.0  # pixels; places that are nearer than this share a label
_MOST = 4  # names in one label
_GAPS = (8.0, 22.0, 40.0)  # pixels between a place and its label
_SIDES = ((1, 1), (-1, 1), (1, -1), (-1, -1), (1, 0), (-1, 0), (0, 1), (0, -1))  # in the order of preference
_STEP = 6.0  # pixels between the points that stand for a line
_HIDES = {
    "label": 1000.0,
    "outside": 1000.0,
    "place": 100.0,
    "line": 1.0,
    "far": 3.0,
    "astray": 5.0,
}  # what is avoided most


def name_places(figure: Figure, axes: Any, places: Mapping[str, Array], color: str, fontsize: float = 11) -> None:
    """Write names beside places; called last, for it looks at what is drawn.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    axes : matplotlib.axes.Axes
        Of the figure.
    places : mapping of str to ndarray, shape (2,)
        In the units of the axes; those off the axes are left out.
    color : str
        Of the text.
    fontsize : float
    """
    figure.draw_without_rendering()  # only now the layout is known
    window = axes.get_window_extent()
    pixels = {name: axes.transData.transform(place) for name, place in places.items()}
    inside = {name: at for name, at in pixels.items() if window.contains(*at)}
    gathered = _gathered(inside)
    lines = _drawn(axes)
    taken: list[Array] = [_box(text.get_window_extent()) for text in axes.texts if text.get_text()]
    dots = np.array([at for _, at in gathered]).reshape(-1, 2)
    for names, at in gathered:
        shown = ", ".join(names if len(names) <= _MOST else [*names[:_MOST], f"{len(names) - _MOST} more"])
        text = axes.annotate(
            shown,
            places[names[0]],
            xytext=(0, 0),
            textcoords="offset pixels",
            ha="center",
            va="center",
            color=color,
            fontsize=fontsize,
            bbox={"boxstyle": "round,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.75},
            arrowprops={"arrowstyle": "-", "color": color, "linewidth": 0.8, "shrinkA": 0, "shrinkB": 3},
            zorder=5,
        )
        half = 0.5 * np.ptp(_box(text.get_window_extent()), axis=0) + 2.0
        offsets = [np.array(side) * (half + gap) for gap in _GAPS for side in _SIDES]
        boxes = [np.stack([at + offset - half, at + offset + half]) for offset in offsets]
        costs = [
            _cost(box, taken, dots, lines, _box(window))
            + _HIDES["far"] * (i // len(_SIDES))
            + _HIDES["astray"] * _astray(box, at, dots)
            for i, box in enumerate(boxes)
        ]
        best = int(np.argmin(costs))
        text.xyann = tuple(offsets[best])
        if best < len(_SIDES):  # near enough without a line
            text.arrow_patch.set_visible(False)
        taken.append(boxes[best])


def _gathered(places: Mapping[str, Array]) -> list[tuple[list[str], Array]]:
    """Return names that are at one place, with it."""
    found: list[tuple[list[str], Array]] = []
    for name, place in places.items():
        for names, at in found:
            if np.abs(place - at).max() < _SAME:
                names.append(name)
                break
        else:
            found.append(([name], np.asarray(place)))
    return found


def _drawn(axes: Any) -> Array:
    """Return points (n, 2) [pixels] along the lines of the axes."""
    points = [np.empty((0, 2))]
    for line in axes.lines:
        if not line.get_transform().contains_branch(axes.transData):
            continue
        path = axes.transData.transform(np.column_stack(line.get_data()).astype(float))
        path = path[np.isfinite(path).all(axis=-1)]
        for begin, end in pairwise(path):
            count = min(200, int(np.abs(end - begin).max() / _STEP) + 1)
            points.append(begin + np.linspace(0, 1, count, endpoint=False)[:, None] * (end - begin))
    return np.concatenate(points)


def _box(extent: Any) -> Array:
    """Return a box as its lower left and upper right corner, shape (2, 2)."""
    return np.array([[extent.x0, extent.y0], [extent.x1, extent.y1]])


def _astray(box: Array, place: Array, dots: Array) -> bool:
    """Return whether a label in a box is nearer to another place than to its own."""

    def distance(points: Array) -> Array:
        return np.asarray(np.linalg.norm(points - np.clip(points, box[0], box[1]), axis=-1))

    return bool(distance(dots).min() < distance(place) - 0.5)


def _cost(box: Array, taken: list[Array], dots: Array, lines: Array, window: Array) -> float:
    """Return how much a label in a box would hide."""
    overlaps = sum(bool(np.all((box[0] < other[1]) & (other[0] < box[1]))) for other in taken)
    outside = not (np.all(box[0] >= window[0]) and np.all(box[1] <= window[1]))
    hidden = [np.count_nonzero(np.all((points > box[0]) & (points < box[1]), axis=-1)) for points in (dots, lines)]
    found = _HIDES["label"] * overlaps + _HIDES["outside"] * outside
    return found + _HIDES["place"] * hidden[0] + _HIDES["line"] * hidden[1]
