"""Where it takes place: tracks along the ground and from the side, and the estimates around the target."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray

from quietfix.diagrams.figures.clouds import draw_cloud, last_offsets, wider_axis
from quietfix.diagrams.figures.shared.labels import name_places
from quietfix.diagrams.figures.shared.style import (
    Look,
    grid,
    legend_beside,
    legend_outside,
    looks,
    new_figure,
    title,
)
from quietfix.diagrams.figures.shared.ticks import plain_ticks
from quietfix.diagrams.figures.shared.views import View, error_axes, place_names, views_of
from quietfix.diagrams.quantities.frame import Frame, frame_of
from quietfix.diagrams.quantities.states import POSITION

__all__ = ["draw_ground", "draw_tracks", "has_ground", "in_pairs", "tracks_of"]

Array = NDArray[np.float64]

_PLATFORMS, _TARGET_TRACK = "0.35", "#d55e00"
_MOST_TRIALS = 20  # tracks of the target; enough to see how trials differ
_THINNEST = 1e-3  # km or deg
_AT_REST = 1.0  # m; what moves less is drawn as a place


def has_ground(dataset: xr.Dataset) -> bool:
    """Return whether a result's frame has a ground, and its states a place there."""
    ground = frame_of(dataset).ground
    return ground is not None and set(ground.components) <= {str(name) for name in dataset["state"].values}


def draw_ground(dataset: xr.Dataset) -> Figure:
    """Draw ground tracks of platforms and target, and where the estimates lie at the last epoch.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result; ``platforms`` (time, platform, 6) or (trial, time, platform, 6), if it is there.

    Returns
    -------
    matplotlib.figure.Figure
        First the tracks on the ground axes of the frame, a dot is where a track begins; then errors along the ground at
        the last epoch, in metres or kilometres. Where there is a third axis both are shown from the side as well.

    Raises
    ------
    ValueError
        If the frame has no ground, or the states no place there.
    """
    frame, names = frame_of(dataset), place_names(dataset)
    if frame.ground is None or not has_ground(dataset):
        raise ValueError(f"ground: states {list(dataset['state'].values)} in {frame} axes have none")
    platforms, targets = tracks_of(dataset, names)
    words, rotation = error_axes(frame, len(names))
    offsets = last_offsets(dataset, names, rotation)
    views = views_of(frame, len(names), targets[0][0], _longer(frame, platforms, targets))
    pairs = [(0, 1)] if len(words) < 3 else [(0, 1), (wider_axis(offsets), 2)]
    shown = looks(dataset)
    figure, panels = in_pairs(len(views) + len(pairs) * len(shown))
    for axes, view in zip(panels, views, strict=False):
        draw_tracks(axes, view, platforms, targets)
    draw_clouds(figure, panels[len(views) :], offsets, pairs, words, shown)
    figure.suptitle(title(dataset))
    for axes, view in zip(panels, views, strict=False):
        name_places(figure, axes, {name: view.project(place)[-1] for name, place in platforms.items()}, _PLATFORMS)
    return figure


def in_pairs(count: int) -> tuple[Figure, list[Any]]:
    """Return a figure and so many axes, two beside each other."""
    rows = -(-count // 2)
    figure, panels = new_figure(6.5 if rows == 1 else 0.5 + 5.6 * rows, rows, 2, squeeze=False)
    every = list(panels.ravel())
    for unused in every[count:]:
        unused.remove()
    return figure, every[:count]


def draw_clouds(
    figure: Figure,
    panels: Sequence[Any],
    offsets: xr.DataArray,
    pairs: Sequence[tuple[int, int]],
    words: Sequence[str],
    shown: Sequence[Mapping[str, Look]],
) -> None:
    """Draw the errors of every group of estimators along every pair of axes."""
    each = len(pairs)
    for i, group in enumerate(shown):
        own = panels[i * each : (i + 1) * each]
        for axes, pair in zip(own, pairs, strict=True):
            draw_cloud(axes, offsets, pair, (words[pair[0]], words[pair[1]]), group)
        if len(shown) > 1:
            legend_beside(own[-1], markerscale=1.5)
        else:
            legend_outside(figure, own[0], markerscale=1.5)


def _longer(frame: Frame, platforms: Mapping[str, Array], targets: Sequence[Array]) -> int:
    """Return along which of the two axes of the ground the tracks are longer."""
    if frame.ground is None:
        return 0
    around = targets[0][0]
    seen = [frame.ground.places(place, around) for place in (*platforms.values(), *targets) if place.size]
    extent = np.ptp(np.concatenate(seen), axis=0)
    return int(extent[1] * frame.ground.stretch(around) > extent[0])


def tracks_of(dataset: xr.Dataset, names: Sequence[str]) -> tuple[dict[str, Array], list[Array]]:
    """Return the tracks (time, axes) [m] of the platforms by name, and of the target in a few trials, where known."""
    truth = dataset["truth"].sel(state=list(names))
    if "trial" in truth.dims:
        courses = list(truth.isel(trial=slice(_MOST_TRIALS)).transpose("trial", "time", "state").values)
    else:
        courses = [truth.transpose("time", "state").values]
    known = [course[np.isfinite(course).all(axis=-1)] for course in courses]
    targets = [course for course in known if len(course)] or [np.zeros((1, len(names)))]
    if "platforms" not in dataset:
        return {}, targets
    states = dataset["platforms"]
    states = states.isel(trial=0) if "trial" in states.dims else states
    columns = [POSITION.index(name) for name in names]
    places = states.transpose("platform", "time", "coordinate").values[..., columns]
    found = {str(name): place for name, place in zip(dataset["platform"].values, places, strict=True)}
    finite = {name: place[np.isfinite(place).all(axis=-1)] for name, place in found.items()}
    return {name: place for name, place in finite.items() if len(place)}, targets


def draw_tracks(axes: Any, view: View, platforms: Mapping[str, Array], targets: Sequence[Array]) -> None:
    """Draw platforms and target as a view has them."""
    for i, place in enumerate(platforms.values()):
        _track(axes, place, view, _PLATFORMS, None if i else "platforms", 1.5)
    for i, course in enumerate(targets):
        _track(axes, course, view, _TARGET_TRACK, None if i else "target", 2.5 if len(targets) == 1 else 1.0)
    axes.margins(0.15)
    if view.stretch is not None:
        axes.set_aspect(view.stretch, adjustable="datalim")
    _not_of_rounding(axes)
    axes.set(xlabel=view.labels[0], ylabel=view.labels[1], title=f"tracks {view.title}, from the dot on")
    plain_ticks(axes)
    # below the axes, where it hides no track and no name
    axes.legend(frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=3)
    grid(axes)


def _not_of_rounding(axes: Any) -> None:
    """Widen a vertical axis on which all is at one height, but for rounding."""
    low, high = axes.get_ylim()
    if high - low < _THINNEST:
        middle = 0.5 * (low + high)
        axes.set_ylim(middle - 50 * _THINNEST, middle + 50 * _THINNEST)


def _track(axes: Any, place: Array, view: View, color: str, label: str | None, width: float) -> None:
    """Draw a track (time, axes) with a dot at its beginning."""
    drawn = view.project(place)
    moves = np.ptp(place, axis=0).max() > _AT_REST
    if moves:
        axes.plot(drawn[:, 0], drawn[:, 1], color=color, linewidth=width, label=label)
    axes.plot(drawn[:1, 0], drawn[:1, 1], "o", color=color, markersize=6, label=None if moves else label)
