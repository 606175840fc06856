"""Where the estimates end around the truth: a dot for each trial, seen from above and from the side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.figures.shared.curves import labelled
from quietfix.diagrams.figures.shared.limits import reach
from quietfix.diagrams.figures.shared.style import Look, grid

__all__ = ["draw_cloud", "last_offsets", "wider_axis"]

Array = NDArray[np.float64]

_MOST_DOTS = 20_000  # more would hide each other
_KM, _IN_KM = 1e3, 1e3  # m; clouds that reach further than this are drawn in kilometres
_TRUTH = "black"


def last_offsets(dataset: xr.Dataset, names: Sequence[str], rotation: Any) -> xr.DataArray:
    """Return estimate minus truth at the last epoch along some axes.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result.
    names : sequence of str
        Components of a place.
    rotation : callable
        Places (..., size) -> (..., axes, size), as `quietfix.diagrams.figures.shared.views.error_axes` returns it.

    Returns
    -------
    xarray.DataArray, dims (estimator, trial, axis)
        [m]; of the first 20 000 trials; NaN where there is no estimate.
    """
    last = dataset[["truth", "estimate"]].isel(time=-1, trial=slice(_MOST_DOTS)).sel(state=list(names)).load()
    truth = last["truth"].values
    estimate = last["estimate"].transpose("estimator", "trial", "state").values
    with np.errstate(invalid="ignore"):
        turn = rotation(np.broadcast_to(truth, estimate.shape))
        offset = np.asarray((turn @ (estimate - truth)[..., None])[..., 0])
    offset[~np.isfinite(offset).all(axis=-1)] = np.nan
    return xr.DataArray(
        offset, {"estimator": dataset["estimator"], "time": last["time"]}, ("estimator", "trial", "axis")
    )


def wider_axis(offsets: xr.DataArray) -> int:
    """Return along which of the two axes on the ground the errors are wider."""
    size = np.abs(offsets.values[..., :2]).reshape(-1, 2)
    size = size[np.isfinite(size).all(axis=-1)]
    return int(np.argmax(np.median(size, axis=0))) if size.size else 0


def draw_cloud(
    axes: Any, offsets: xr.DataArray, pair: tuple[int, int], words: tuple[str, str], group: Mapping[str, Look]
) -> None:
    """Draw the dots of a group of estimators along two axes; those beyond the edge are marked on it.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    offsets : xarray.DataArray
        From `last_offsets`.
    pair : (int, int)
        Which of its axes are the horizontal and the vertical one.
    words : (str, str)
        What they are called.
    group : mapping of str to Look
        Estimators.
    """
    names = list(group)
    clouds = offsets.sel(estimator=names).values[..., list(pair)]
    there = np.isfinite(clouds).all(axis=-1)
    edge, beyond = reach(clouds)
    widest = edge if edge is not None else float(np.abs(clouds[there]).max(initial=0.0))
    unit, scale = ("km", _KM) if widest > _IN_KM else ("m", 1.0)
    sizes = [np.square(cloud[known]).sum() / max(known.sum(), 1) for cloud, known in zip(clouds, there, strict=True)]
    ranks = np.argsort(np.argsort(sizes, kind="stable"))  # the wider a cloud the lower it lies
    for name, cloud, known, rank in zip(names, clouds, there, ranks, strict=True):
        missing = np.count_nonzero(~known)
        label = labelled(name, [f"{missing} of {known.size} without an estimate"] if missing else [])
        far = known & (np.abs(cloud).max(axis=-1) > (np.inf if edge is None else edge))
        look, x = group[name], cloud / scale
        axes.plot(*x[known & ~far].T, label=label, zorder=3 - 0.01 * rank, **look.dots())
        if edge is not None and far.any():
            _mark(axes, x[far] * (edge / np.abs(cloud[far]).max(axis=-1, keepdims=True)), look)
    _finish(axes, None if edge is None else edge / scale, widest)
    said = f"\n({beyond} beyond the edge, marked on it)" if beyond else ""
    axes.set(xlabel=f"{words[0]} [{unit}]", ylabel=f"{words[1]} [{unit}]", title=f"{_title(offsets, pair)}{said}")


def _title(offsets: xr.DataArray, pair: tuple[int, int]) -> str:
    side = "" if pair == (0, 1) else ", from the side"
    return f"estimate minus truth at {float(offsets['time']):g} s{side}"


def _mark(axes: Any, at: Array, look: Look) -> None:
    """Draw hollow diamonds on the edge, in the direction of the dots that lie beyond it."""
    keywords: Any = {"markerfacecolor": "none", "clip_on": False, "zorder": 5, "label": "_beyond"}
    axes.plot(*at.T, "D", color=look.color, markersize=6, markeredgewidth=1.3, **keywords)


def _finish(axes: Any, edge: float | None, widest: float) -> None:
    if not widest > 0:
        edge = 1.0  # nothing but the truth
    if edge is not None:
        axes.set(xlim=(-edge, edge), ylim=(-edge, edge))
    axes.axhline(0, color="0.6", linewidth=0.8, zorder=1)
    axes.axvline(0, color="0.6", linewidth=0.8, zorder=1)
    axes.plot(0, 0, "+", color=_TRUTH, markersize=14, markeredgewidth=2, zorder=4, label="_truth")
    # limits that are set stay: a smaller box then, for matplotlib would overrule them
    axes.set_aspect("equal", adjustable="box" if edge is not None else "datalim")
    axes.locator_params(axis="x", nbins=6)
    grid(axes)
