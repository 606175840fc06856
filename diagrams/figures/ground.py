"""Where it takes place: ground tracks, and the estimates around the target."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray

from diagrams.figures.style import grid, legend_outside, looks, new_figure, title
from systems.frames import ecef_to_geodetic, enu_rotation

__all__ = ["draw_ground"]

Array = NDArray[np.float64]

_CARRIERS = "0.35"
_TARGET = "black"


def draw_ground(dataset: xr.Dataset) -> Figure:
    """Draw ground tracks of carriers and target, and where the estimates lie at the last epoch.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result; ``platforms`` (time, platform, 6) or (trial, time, platform, 6) Earth-fixed, if it is there.

    Returns
    -------
    matplotlib.figure.Figure
        Left: longitude and latitude; a dot is where a track begins. Right: horizontal errors at the last epoch [km].
    """
    figure, (left, right) = new_figure(columns=2)
    truth = dataset["truth"]
    if "trial" in truth.dims:
        _draw_tracks(left, truth.transpose("trial", "time", "state").values[..., :3], dataset)
    else:
        _draw_tracks(left, truth.transpose("time", "state").values[None, :, :3], dataset)
    _draw_last_errors(right, dataset)
    figure.suptitle(title(dataset))
    legend_outside(figure, right, markerscale=2.5)
    return figure


def _track(axes: Any, position: Array, color: str, **keywords: Any) -> None:
    """Draw a ground track (time, 3) with a dot at its beginning."""
    latitude, longitude, _ = ecef_to_geodetic(position[np.isfinite(position).all(axis=-1)])
    if latitude.size == 0:
        return
    east = np.degrees(np.unwrap(longitude))
    axes.plot(east, np.degrees(latitude), color=color, **keywords)
    axes.plot(east[:1], np.degrees(latitude[:1]), "o", color=color, markersize=6)


def _draw_tracks(axes: Any, target: Array, dataset: xr.Dataset) -> None:
    if "platforms" in dataset:
        carriers = dataset["platforms"].values
        carriers = carriers if carriers.ndim == 3 else carriers[0]
        for i in range(carriers.shape[1]):
            _track(
                axes,
                carriers[:, i, :3],
                _CARRIERS,
                linewidth=1.5,
                label="carriers, from the dot on" if i == 0 else None,
            )
            place = ecef_to_geodetic(carriers[-1, i, :3])
            axes.annotate(
                str(i), np.degrees([place[1], place[0]]), xytext=(4, 2), textcoords="offset points", color=_CARRIERS
            )
    shown = target[:20]  # enough to see how trials differ
    for i, course in enumerate(shown):
        _track(axes, course, "#d55e00", linewidth=2.5 if len(shown) == 1 else 1.0, label="target" if i == 0 else None)
    latitude = ecef_to_geodetic(target[0, 0])[0]
    axes.set_aspect(1 / max(0.05, float(np.cos(np.nan_to_num(latitude)))), adjustable="datalim")
    axes.set(xlabel="longitude [deg]", ylabel="latitude [deg]", title="ground tracks")
    axes.margins(0.1)
    axes.legend(frameon=False, loc="best")
    grid(axes)


def _draw_last_errors(axes: Any, dataset: xr.Dataset) -> None:
    last = dataset.isel(time=-1)
    truth = last["truth"].values[..., :3]
    latitude, longitude, _ = ecef_to_geodetic(truth)
    local = enu_rotation(np.nan_to_num(latitude), np.nan_to_num(longitude))
    estimate = last["estimate"].transpose("estimator", "trial", "state").values[..., :3]
    with np.errstate(invalid="ignore"):
        offset = (local @ (estimate - truth)[..., None])[..., 0] / 1e3
    for i, (name, look) in enumerate(looks(dataset).items()):
        finite = offset[i][np.isfinite(offset[i]).all(axis=-1)]
        axes.plot(finite[:, 0], finite[:, 1], ".", color=look.color, markersize=5, label=name, zorder=3 - 0.01 * i)
    axes.axhline(0, color="0.6", linewidth=0.8)
    axes.axvline(0, color="0.6", linewidth=0.8)
    axes.plot(0, 0, "+", color=_TARGET, markersize=14, markeredgewidth=2, zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(
        xlabel="east [km]",
        ylabel="north [km]",
        title=f"estimate minus truth at {float(last['time']):g} s, one dot per trial",
    )
    grid(axes)
