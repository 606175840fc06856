"""Where it takes place: ground tracks, and the estimates around the target."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray

from diagrams.figures.style import grid, legend_outside, looks, new_figure, title
from diagrams.states import POSITION
from systems.geodetic import ecef_to_geodetic, enu_rotation

__all__ = ["draw_ground"]

Array = NDArray[np.float64]

_CARRIERS = "0.35"
_TARGET = "black"
_LABEL: dict[str, Any] = {  # readable where a track or a dot lies below it
    "xytext": (5, 3),
    "textcoords": "offset points",
    "color": _CARRIERS,
    "bbox": {"boxstyle": "round,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
    "zorder": 5,
}
_PLANES = {"launch": (("x", "down-range X"), ("z", "Z"))}
"""Which two axes lie along the ground in a frame that is not Earth-fixed, and their names; else the first two."""


def draw_ground(dataset: xr.Dataset) -> Figure:
    """Draw ground tracks of carriers and target, and where the estimates lie at the last epoch.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result; ``platforms`` (time, platform, 6) or (trial, time, platform, 6) Earth-fixed, if it is there.

    Returns
    -------
    matplotlib.figure.Figure
        Left: longitude and latitude, or east and north [km] in local axes; a dot is where a track begins. Right:
        horizontal errors at the last epoch [m], or [km] where one is more than a kilometre. In inertial and launch
        axes: the same in the plane that lies along the ground.
    """
    figure, (left, right) = new_figure(columns=2)
    frame = dataset.attrs.get("frame", "earth_fixed")
    if frame not in ("earth_fixed", "local"):
        _draw_plane(left, right, dataset, _PLANES.get(frame, (("x", "x"), ("y", "y"))))
        figure.suptitle(title(dataset))
        legend_outside(figure, right, markerscale=2.5)
        return figure
    truth = _positions(dataset)["truth"]
    if "trial" in truth.dims:
        _draw_tracks(left, truth.transpose("trial", "time", "state").values, dataset)
    else:
        _draw_tracks(left, truth.transpose("time", "state").values[None], dataset)
    _draw_last_errors(right, dataset)
    figure.suptitle(title(dataset))
    legend_outside(figure, right, markerscale=2.5)
    return figure


def _positions(dataset: xr.Dataset) -> xr.Dataset:
    """Return truth and estimates with x, y, z alone, as far as they are there."""
    placed = [name for name in POSITION if name in dataset["state"].values]
    return dataset[["truth", "estimate"]].sel(state=placed)


def _local(dataset: xr.Dataset) -> bool:
    return dataset.attrs.get("frame") == "local"


def _on_map(position: Array, middle: float | None) -> tuple[Array, Array]:
    """Return longitude and latitude [deg], or east and north [km], of a track (time, >= 2).

    The longitudes have no jump and begin within half a turn of `middle` [deg]; None: local axes.
    """
    if middle is None:
        return position[..., 0] / 1e3, position[..., 1] / 1e3
    latitude, longitude, _ = ecef_to_geodetic(position)
    across = np.degrees(np.unwrap(longitude))
    return across - 360 * np.round((across[:1] - middle) / 360), np.degrees(latitude)


def _track(axes: Any, position: Array, color: str, middle: float | None, **keywords: Any) -> tuple[float, float] | None:
    """Draw a ground track (time, >= 2) with a dot at its beginning; return where it ends, if it is anywhere."""
    across, along = _on_map(position[np.isfinite(position).all(axis=-1)], middle)
    if along.size == 0:
        return None
    axes.plot(across, along, color=color, **keywords)
    axes.plot(across[:1], along[:1], "o", color=color, markersize=6)
    return float(across[-1]), float(along[-1])


def _draw_tracks(axes: Any, target: Array, dataset: xr.Dataset) -> None:
    local = _local(dataset)
    target = target[..., :2] if local else target
    middle = None if local else float(np.degrees(np.nan_to_num(ecef_to_geodetic(target[0, 0])[1])))
    if "platforms" in dataset:
        carriers = dataset["platforms"].values
        carriers = carriers if carriers.ndim == 3 else carriers[0]
        for i in range(carriers.shape[1]):
            label = "carriers, from the dot on" if i == 0 else None
            last = _track(axes, carriers[:, i, :3], _CARRIERS, middle, linewidth=1.5, label=label)
            if last is not None:
                axes.annotate(str(i), last, **_LABEL)
    shown = target[:20]  # enough to see how trials differ
    for i, course in enumerate(shown):
        _track(
            axes,
            course,
            "#d55e00",
            middle,
            linewidth=2.5 if len(shown) == 1 else 1.0,
            label="target" if i == 0 else None,
        )
    shrunk = 1.0 if local else max(0.05, float(np.cos(np.nan_to_num(ecef_to_geodetic(target[0, 0])[0]))))
    axes.set_aspect(1 / shrunk, adjustable="datalim")
    names = ("east [km]", "north [km]") if local else ("longitude [deg]", "latitude [deg]")
    axes.set(xlabel=names[0], ylabel=names[1], title="ground tracks")
    axes.margins(0.1)
    axes.legend(frameon=False, loc="best")
    grid(axes)


def _draw_plane(left: Any, right: Any, dataset: xr.Dataset, plane: tuple[tuple[str, str], tuple[str, str]]) -> None:
    (first, across), (second, up) = plane
    positions = _positions(dataset)
    i, j = (list(positions["state"].values).index(name) for name in (first, second))
    known = positions["truth"]
    truth = known.transpose("trial", "time", "state").values if "trial" in known.dims else known.values[None]
    if "platforms" in dataset:
        carriers = dataset["platforms"].values
        carriers = (carriers if carriers.ndim == 3 else carriers[0]) / 1e3
        u, v = POSITION.index(first), POSITION.index(second)
        left.plot(carriers[..., u], carriers[..., v], color=_CARRIERS, linewidth=1.5)
        left.plot(carriers[0, :, u], carriers[0, :, v], "o", color=_CARRIERS, markersize=6, label="carriers")
        for k, place in enumerate(carriers[-1]):
            left.annotate(str(k), place[[u, v]], **_LABEL)
    for k, course in enumerate(truth[:20] / 1e3):
        left.plot(course[:, i], course[:, j], color="#d55e00", linewidth=2.0, label="target" if k == 0 else None)
    left.set(xlabel=f"{across} [km]", ylabel=f"{up} [km]", title="tracks seen from above")
    left.legend(frameon=False, loc="best")
    last = positions.isel(time=-1)
    difference = (last["estimate"] - last["truth"]).transpose("estimator", "trial", "state").values
    for k, (name, look) in enumerate(looks(dataset).items()):
        finite = difference[k][np.isfinite(difference[k][:, [i, j]]).all(axis=-1)]
        right.plot(finite[:, i], finite[:, j], ".", color=look.color, markersize=5, label=name)
    right.plot(0, 0, "+", color=_TARGET, markersize=14, markeredgewidth=2)
    right.set(
        xlabel=f"{across} [m]",
        ylabel=f"{up} [m]",
        title=f"estimate minus truth at {float(last['time']):g} s, one dot per trial",
    )
    for axes in (left, right):
        axes.set_aspect("equal", adjustable="datalim")
        grid(axes)


def _draw_last_errors(axes: Any, dataset: xr.Dataset) -> None:
    last = _positions(dataset).isel(time=-1)
    truth = last["truth"].values
    estimate = last["estimate"].transpose("estimator", "trial", "state").values
    if _local(dataset):
        offset = (estimate - truth)[..., :2]
    else:
        latitude, longitude, _ = ecef_to_geodetic(truth)
        rotation = enu_rotation(np.nan_to_num(latitude), np.nan_to_num(longitude))
        with np.errstate(invalid="ignore"):
            offset = (rotation @ (estimate - truth)[..., None])[..., :2, 0]
    far = bool(np.max(np.abs(offset), initial=0.0, where=np.isfinite(offset)) > 1e3)
    scale, unit = (1e3, "km") if far else (1.0, "m")
    offset = offset / scale
    clouds = [cloud[np.isfinite(cloud).all(axis=-1)] for cloud in offset]
    widths = [np.square(cloud).sum() / max(len(cloud), 1) for cloud in clouds]
    wider = np.argsort(np.argsort(widths, kind="stable"))  # the wider a cloud the lower it lies
    for cloud, rank, (name, look) in zip(clouds, wider, looks(dataset).items(), strict=True):
        axes.plot(cloud[:, 0], cloud[:, 1], ".", color=look.color, markersize=5, label=name, zorder=3 - 0.01 * rank)
    if not any(map(len, clouds)):
        axes.set(xlim=(-1, 1), ylim=(-1, 1))  # nothing but the truth
    axes.axhline(0, color="0.6", linewidth=0.8)
    axes.axvline(0, color="0.6", linewidth=0.8)
    axes.plot(0, 0, "+", color=_TARGET, markersize=14, markeredgewidth=2, zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(
        xlabel=f"east [{unit}]",
        ylabel=f"north [{unit}]",
        title=f"estimate minus truth at {float(last['time']):g} s, one dot per trial",
    )
    grid(axes)
