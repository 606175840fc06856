"""Where it takes place around the Earth: orbits in the plane of the target's and from the side, and the last errors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from quietfix.diagrams.figures.clouds import last_offsets
from quietfix.diagrams.figures.ground import draw_clouds, draw_tracks, in_pairs, tracks_of
from quietfix.diagrams.figures.shared.labels import name_places
from quietfix.diagrams.figures.shared.style import looks, title
from quietfix.diagrams.figures.shared.views import View
from quietfix.diagrams.quantities.frame import INERTIAL, frame_of
from quietfix.diagrams.quantities.states import POSITION

__all__ = ["draw_orbits", "has_orbits"]

Array = NDArray[np.float64]

_KM = 1e3
_EARTH = 6371.0  # km; mean radius, for the eye
_WORDS = ("along the target's orbit", "radially", "across the orbit")
_PAIRS = ((0, 1), (0, 2))


def has_orbits(dataset: xr.Dataset) -> bool:
    """Return whether a result's axes are inertial, and its states a place and a way in them."""
    placed = set(POSITION) <= {str(name) for name in dataset["state"].values}
    return frame_of(dataset) is INERTIAL and placed and dataset.sizes["time"] > 1


def draw_orbits(dataset: xr.Dataset) -> Figure:
    """Draw the orbits in the plane of the target's and from the side, and where the estimates lie at the last epoch.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result; ``platforms`` (time, platform, 6) or (trial, time, platform, 6), if it is there.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If there are no orbits in it.
    """
    if not has_orbits(dataset):
        raise ValueError(f"orbits: states {list(dataset['state'].values)} in {frame_of(dataset)} axes have none")
    platforms, targets = tracks_of(dataset, POSITION)
    plane = _axes(targets[0][0], targets[0][min(1, len(targets[0]) - 1)])
    views = [
        View("in the plane of the target's orbit", ("ahead [km]", "outwards [km]"), _seen(plane[[0, 1]]), 1.0),
        View("from the side", ("ahead [km]", "across [km]"), _seen(plane[[0, 2]]), 1.0),
    ]
    final = [_axes(*course[-2:]) for course in targets if len(course) > 1]
    turn = final[0] if final else plane
    offsets = last_offsets(dataset, POSITION, lambda places: np.broadcast_to(turn, (*places.shape[:-1], 3, 3)))
    shown = looks(dataset)
    figure, panels = in_pairs(2 + 2 * len(shown))
    for axes, view in zip(panels, views, strict=False):
        axes.add_patch(Circle((0, 0), _EARTH, facecolor="0.93", edgecolor="0.7", zorder=0, label="Earth"))
        draw_tracks(axes, view, platforms, targets)
    draw_clouds(figure, panels[2:], offsets, _PAIRS, _WORDS, shown)
    figure.suptitle(title(dataset))
    for axes, view in zip(panels, views, strict=False):
        ends = {name: view.project(place)[-1] for name, place in platforms.items()}
        name_places(figure, axes, ends, "0.35")
    return figure


def _axes(place: Array, later: Array) -> Array:
    """Return unit vectors ahead, outwards and across of an orbit at the later of two places, as rows."""
    outwards = later / np.linalg.norm(later)
    across = np.cross(place, later)
    if not np.linalg.norm(across) > 0:  # straight up or at rest
        across = np.cross(outwards, np.eye(3)[np.argmin(np.abs(outwards))])
    across = across / np.linalg.norm(across)
    return np.stack([np.cross(across, outwards), outwards, across])


def _seen(rows: Array) -> Callable[[Array], Array]:
    return lambda places: places @ rows.T / _KM
