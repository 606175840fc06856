"""Where it takes place: tracks along the ground, and the estimates around the target."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from quietfix.diagrams.figures.labels import name_places
from quietfix.diagrams.figures.style import grid, legend_outside, looks, new_figure, title
from quietfix.diagrams.figures.ticks import plain_ticks
from quietfix.diagrams.quantities.frame import Ground, frame_of
from quietfix.diagrams.quantities.states import POSITION

__all__ = ["draw_ground", "has_ground", "reach"]

Array = NDArray[np.float64]
Project = Callable[[Array], Array]

_PLATFORMS = "0.35"
_TARGET, _TARGET_TRACK = "black", "#d55e00"
_MOST_TRIALS = 20  # tracks of the target; enough to see how trials differ
_MOST_DOTS = 20_000  # more would hide each other
_AT_REST = 1.0  # m; what moves less is drawn as a place
_EDGE, _MOST_OF_THEM = 3.0, 90  # the axes end at so many times what so many percent of the dots keep
_KM, _IN_KM = 1e3, 1e3  # m; clouds that reach further than this are drawn in kilometres


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
        Left: the tracks on the ground axes of the frame; a dot is where a track begins. Right: errors along the
        ground at the last epoch, in metres or kilometres.

    Raises
    ------
    ValueError
        If the frame has no ground, or the states no place there.
    """
    ground = frame_of(dataset).ground
    if ground is None or not has_ground(dataset):
        raise ValueError(f"ground: states {list(dataset['state'].values)} in {frame_of(dataset)} axes have none")
    figure, (left, right) = new_figure(columns=2)
    ends = _draw_tracks(left, dataset, ground)
    _draw_last_errors(right, dataset, ground)
    figure.suptitle(title(dataset))
    legend_outside(figure, right, markerscale=2.0)
    name_places(figure, left, ends, _PLATFORMS)
    return figure


def _positions(dataset: xr.Dataset) -> xr.Dataset:
    """Return truth and estimates with x, y, z alone, as far as they are there."""
    placed = [name for name in POSITION if name in dataset["state"].values]
    return dataset[["truth", "estimate"]].sel(state=placed)


def _track(axes: Any, place: Array, project: Project, color: str, label: str | None, width: float) -> Array | None:
    """Draw a track (time, axes) with a dot at its beginning; return where it ends (2,), None if nowhere."""
    known = place[np.isfinite(place).all(axis=-1)]
    if len(known) == 0:
        return None
    drawn = project(known)
    moves = np.ptp(known, axis=0).max() > _AT_REST
    if moves:
        axes.plot(drawn[:, 0], drawn[:, 1], color=color, linewidth=width, label=label)
    axes.plot(drawn[:1, 0], drawn[:1, 1], "o", color=color, markersize=6, label=None if moves else label)
    return np.asarray(drawn[-1])


def _draw_tracks(axes: Any, dataset: xr.Dataset, ground: Ground) -> dict[str, Array]:
    """Draw platforms and target; return where the platforms end, by name."""
    known = _positions(dataset)["truth"]
    if "trial" in known.dims:
        target = known.isel(trial=slice(_MOST_TRIALS)).transpose("trial", "time", "state").values
    else:
        target = known.values[None]

    def project(places: Array) -> Array:
        return ground.places(places, target[0, 0])

    ends = _draw_platforms(axes, dataset["platforms"], project) if "platforms" in dataset else {}
    for i, course in enumerate(target):
        _track(axes, course, project, _TARGET_TRACK, None if i else "target", 2.5 if len(target) == 1 else 1.0)
    axes.set_aspect(ground.stretch(target[0, 0]), adjustable="datalim")
    axes.set(xlabel=ground.labels[0], ylabel=ground.labels[1], title="tracks along the ground, from the dot on")
    axes.margins(0.15)
    plain_ticks(axes)
    # below the axes, where it hides no track and no name
    axes.legend(frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2)
    grid(axes)
    return ends


def _draw_platforms(axes: Any, platforms: xr.DataArray, project: Project) -> dict[str, Array]:
    states = platforms if "trial" not in platforms.dims else platforms.isel(trial=0)
    places = states.transpose("platform", "time", "coordinate").values[..., :3]
    ends = {}
    for i, (name, place) in enumerate(zip(platforms["platform"].values, places, strict=True)):
        end = _track(axes, place, project, _PLATFORMS, None if i else "platforms", 1.5)
        if end is not None:
            ends[str(name)] = end
    return ends


def _draw_last_errors(axes: Any, dataset: xr.Dataset, ground: Ground) -> None:
    last = _positions(dataset).isel(time=-1, trial=slice(_MOST_DOTS))
    all_trials = dataset.sizes["trial"] <= _MOST_DOTS
    truth = last["truth"].values
    estimate = last["estimate"].transpose("estimator", "trial", "state").values
    offset = ground.offsets(truth, estimate - truth)
    clouds = [cloud[np.isfinite(cloud).all(axis=-1)] for cloud in offset]
    unit = "km" if max((np.abs(cloud).max(initial=0.0) for cloud in clouds), default=0.0) > _IN_KM else "m"
    widths = [np.square(cloud).sum() / max(len(cloud), 1) for cloud in clouds]
    wider = np.argsort(np.argsort(widths, kind="stable"))  # the wider a cloud the lower it lies
    for cloud, rank, (name, look) in zip(clouds, wider, looks(dataset).items(), strict=True):
        x, y = cloud.T / (_KM if unit == "km" else 1.0)
        axes.plot(x, y, label=name, zorder=3 - 0.01 * rank, **look.dots())
    if not any(map(len, clouds)):
        axes.set(xlim=(-1, 1), ylim=(-1, 1))  # nothing but the truth
    beyond = _leave_out_the_lost(axes, np.concatenate(clouds) / (_KM if unit == "km" else 1.0))
    axes.axhline(0, color="0.6", linewidth=0.8)
    axes.axvline(0, color="0.6", linewidth=0.8)
    axes.plot(0, 0, "+", color=_TARGET, markersize=14, markeredgewidth=2, zorder=4)
    dots = "one dot per trial" if all_trials else f"the first {_MOST_DOTS} trials"
    # limits that are set stay: a smaller box then, for matplotlib would overrule them
    axes.set_aspect("equal", adjustable="box" if beyond else "datalim")
    axes.set(
        xlabel=f"{ground.offset_labels[0]} [{unit}]",
        ylabel=f"{ground.offset_labels[1]} [{unit}]",
        title=f"estimate minus truth at {float(last['time']):g} s, {dots}{beyond}",
    )
    axes.locator_params(axis="x", nbins=6)
    grid(axes)


def reach(dots: ArrayLike) -> tuple[float | None, int]:
    """Return where an axis may end so that a few dots far off do not press the others into one point.

    Parameters
    ----------
    dots : array_like, shape (n, 2)
        Around the origin.

    Returns
    -------
    edge : float or None
        Half the width of the axes; None where all dots belong together.
    beyond : int
        How many dots lie outside.
    """
    far = np.abs(np.asarray(dots, dtype=float)).max(axis=-1, initial=0.0)
    far = far[np.isfinite(far)]
    edge = _EDGE * float(np.percentile(far, _MOST_OF_THEM)) if far.size else 0.0
    if not 0 < _EDGE * edge < far.max(initial=0.0):
        return None, 0
    return edge, int(np.count_nonzero(far > edge))


def _leave_out_the_lost(axes: Any, dots: Array) -> str:
    """Limit the axes where a few dots (n, 2) are so far off that nothing else could be seen; say how many."""
    edge, beyond = reach(dots)
    if edge is None:
        return ""
    axes.set(xlim=(-edge, edge), ylim=(-edge, edge))
    return f"\n({beyond} beyond the edge)"
