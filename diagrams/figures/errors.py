"""Errors against time, with the bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from quietfix.diagrams.figures.shared.curves import draw_curves
from quietfix.diagrams.figures.shared.limits import curve_span
from quietfix.diagrams.figures.shared.style import (
    Look,
    grid,
    grouped_figure,
    legend_beside,
    log_scale,
    looks,
    time_label,
    title,
)

__all__ = ["draw_error", "draw_percentiles"]

Array = NDArray[np.float64]
Remarks = Mapping[str, Sequence[str]]

_LABELS = {
    "position": "position error [m]",
    "height": "height error [m]",
    "speed": "horizontal speed error [m/s]",
    "course": "course error [deg]",
    "bias": "bias error [m/s]",
}
_BOUNDS: Mapping[str, tuple[Any, str]] = {
    "bound": ((0, (4, 1.5, 1, 1.5)), "bound, filter's process noise"),
    "bound_truth": ((0, (1, 1.3)), "bound, true motion's process noise"),
}
_BOTH = "bound, with both process noises"
_THIN = 1.3
_WIDE = 26  # characters of the names beside a bound


def draw_error(dataset: xr.Dataset, quantity: str, curve: xr.DataArray, remarks: Remarks | None = None) -> Figure:
    """Draw RMSE and both bounds of one quantity against time.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result.
    quantity : {'position', 'height', 'speed', 'course', 'bias'}
        What is drawn.
    curve : xarray.DataArray, dims (estimator, time)
        Its RMSE.
    remarks : mapping of str to sequence of str, optional
        What the legend says of an estimator beside its name.

    Returns
    -------
    matplotlib.figure.Figure
    """
    shown = looks(dataset)
    figure, panels = grouped_figure(shown, sharex=True, sharey=True)
    bounds = [dataset[name].values for name in _names(dataset, quantity)]
    time = dataset["time"].values
    span = curve_span(list(curve.values), [row for values in bounds for row in values])
    for axes, group in zip(panels[:, 0], shown, strict=True):
        draw_curves(axes, time, curve, group, span, remarks)
        extra = _draw_bounds(axes, dataset, quantity, group)
        log_scale(axes)
        axes.set(ylabel=f"RMSE, {_LABELS[quantity]}", xlim=_ends(time))
        grid(axes)
        legend_beside(axes, extra, len(shown) > 1)
    span.limit(panels[0, 0])
    panels[-1, 0].set_xlabel(time_label(dataset))
    figure.suptitle(title(dataset))
    return figure


def _ends(time: Array) -> tuple[float, float] | None:
    return (time[0], time[-1]) if time[-1] > time[0] else None


def _names(dataset: xr.Dataset, quantity: str) -> list[str]:
    names = [f"{kind}_{quantity}" for kind in _BOUNDS]
    return [name for name in names if name in dataset and dataset[name].notnull().any()]


def _draw_bounds(axes: Any, dataset: xr.Dataset, quantity: str, group: Mapping[str, Look]) -> list[Line2D]:
    """Draw each bound once for the estimators of a group that share it, in the first one's colour.

    Returns
    -------
    list of Line2D
        Entries of the legend: below a heading for each kind, every line with the estimators that it holds for.
    """
    kinds = {kind: _shared(dataset, f"{kind}_{quantity}", group) for kind in _BOUNDS}
    both = _both(*kinds.values())
    sections = [(dashes, head, kinds[kind]) for kind, (dashes, head) in _BOUNDS.items()]
    if both:
        sections = [(_BOUNDS["bound"][0], _BOTH, kinds["bound"])]
    entries = []
    for dashes, head, curves in sections:
        if not curves:
            continue
        entries.append(Line2D([], [], linestyle="none", label=f"{head}:"))
        for members, values in curves:
            style = {"color": group[members[0]].color, "linestyle": dashes, "linewidth": _THIN}
            axes.plot(dataset["time"].values, values, label="_bound", **style)
            names = "all of these" if len(members) == len(group) > 2 else ", ".join(members)
            label = fill(names, _WIDE, break_long_words=False, break_on_hyphens=False)
            entries.append(Line2D([], [], label=label, **style))
    return entries


def _shared(dataset: xr.Dataset, name: str, group: Mapping[str, Look]) -> list[tuple[list[str], Array]]:
    """Return the different curves of a bound, each with the estimators that it holds for."""
    found: list[tuple[list[str], Array]] = []
    if name not in dataset:
        return found
    for estimator in group:
        values = dataset[name].sel(estimator=estimator).values
        if not np.isfinite(values).any():
            continue
        for members, other in found:
            if np.allclose(values, other, rtol=1e-9, equal_nan=True):
                members.append(estimator)
                break
        else:
            found.append(([estimator], values))
    return found


def _both(one: Sequence[tuple[list[str], Array]], other: Sequence[tuple[list[str], Array]]) -> bool:
    """Return whether two kinds of bounds are the same."""
    return [members for members, _ in one] == [members for members, _ in other] and all(
        np.allclose(a, b, rtol=1e-9, equal_nan=True) for (_, a), (_, b) in zip(one, other, strict=True)
    )


def draw_percentiles(
    dataset: xr.Dataset, median: xr.DataArray, ninety: xr.DataArray, remarks: Remarks | None = None
) -> Figure:
    """Draw median and 90 % point of the position error against time; a few lost trials do not show in them.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result.
    median, ninety : xarray.DataArray, dims (estimator, time)
        Of the position error over the trials [m].
    remarks : mapping of str to sequence of str, optional
        What the legend says of an estimator beside its name.

    Returns
    -------
    matplotlib.figure.Figure
    """
    shown = looks(dataset)
    figure, panels = grouped_figure(shown, columns=2, sharex=True, sharey=True)
    time = dataset["time"].values
    span = curve_span([*median.values, *ninety.values])
    for row, group in zip(panels, shown, strict=True):
        for axes, values in zip(row, (median, ninety), strict=True):
            draw_curves(axes, time, values, group, span, remarks)
            log_scale(axes)
            axes.set(xlim=_ends(time))
            grid(axes)
        row[0].set_ylabel(_LABELS["position"])
        legend_beside(row[1], others=len(shown) > 1)
    span.limit(panels[0, 0])
    for axes, name in zip(panels[0], ("median over trials", "90 % point over trials"), strict=True):
        axes.set_title(name)
    for axes in panels[-1]:
        axes.set_xlabel(time_label(dataset))
    figure.suptitle(title(dataset))
    return figure
