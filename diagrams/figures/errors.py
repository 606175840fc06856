"""Errors against time, with the bounds."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from quietfix.diagrams.figures.style import Look, grid, legend_outside, log_scale, looks, new_figure, time_label, title

__all__ = ["draw_error", "draw_percentiles"]

Array = NDArray[np.float64]

_LABELS = {
    "position": "position error [m]",
    "height": "height error [m]",
    "speed": "horizontal speed error [m/s]",
    "course": "course error [deg]",
    "bias": "bias error [m/s]",
}
_BOUNDS = {
    "bound": ((0, (4, 1.5, 1, 1.5)), "bound: filter's process noise"),
    "bound_truth": ((0, (1, 1.3)), "bound: true motion's process noise"),
}


def draw_error(dataset: xr.Dataset, quantity: str, curve: xr.DataArray) -> Figure:
    """Draw RMSE and both bounds of one quantity against time.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result.
    quantity : {'position', 'height', 'speed', 'course', 'bias'}
        What is drawn.
    curve : xarray.DataArray, dims (estimator, time)
        Its RMSE.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure, axes = new_figure()
    time, shown = dataset["time"].values, looks(dataset)
    for name, look in shown.items():
        values = curve.sel(estimator=name).values
        lost = np.isinf(values)
        label = name + (f" (infinite at {lost.sum()} epochs)" if lost.any() else "")
        axes.plot(time, np.where(lost, np.nan, values), label=label, **look.line())
    extra = _draw_bounds(axes, dataset, quantity, shown)
    log_scale(axes)
    axes.set(xlabel=time_label(dataset), ylabel=f"RMSE, {_LABELS[quantity]}", xlim=(time[0], time[-1]))
    _leave_out_the_start(axes, curve.values)
    grid(axes)
    figure.suptitle(title(dataset))
    legend_outside(figure, axes, extra)
    return figure


def _draw_bounds(axes: Any, dataset: xr.Dataset, quantity: str, shown: dict[str, Look]) -> list[Line2D]:
    """Draw each bound once for the estimators that share it, in the first one's colour; return legend entries."""
    time, entries = dataset["time"].values, []
    for kind, (dashes, meaning) in _BOUNDS.items():
        name = f"{kind}_{quantity}"
        if name not in dataset or not dataset[name].notnull().any():
            continue
        drawn: list[Array] = []
        for estimator, look in shown.items():
            values = dataset[name].sel(estimator=estimator).values
            if any(np.allclose(values, other, rtol=1e-9, equal_nan=True) for other in drawn):
                continue
            drawn.append(values)
            axes.plot(time, values, color=look.color, linestyle=dashes, linewidth=1.3)
        entries.append(Line2D([], [], color="0.3", linestyle=dashes, linewidth=1.3, label=meaning))
    if entries:
        entries.append(Line2D([], [], linestyle="none", label="  in the colour of the first\n  estimator it holds for"))
    return entries


def _leave_out_the_start(axes: Any, values: Array) -> None:
    """Limit the axis where the first epochs are so far off that nothing else could be seen."""
    finite = values[np.isfinite(values) & (values > 0)]
    if finite.size == 0:
        return
    usual, highest = np.percentile(finite, 95), finite.max()
    if highest > 30 * usual:
        axes.set_ylim(top=3 * usual)


def draw_percentiles(dataset: xr.Dataset, median: xr.DataArray, ninety: xr.DataArray) -> Figure:
    """Draw median and 90 % point of the position error against time; a few lost trials do not show in them.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result.
    median, ninety : xarray.DataArray, dims (estimator, time)
        Of the position error over the trials [m].

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure, axes = new_figure(rows=1, columns=2, sharex=True, sharey=True)
    time = dataset["time"].values
    panels = ((median, "median over trials"), (ninety, "90 % point over trials"))
    for ax, (values, name) in zip(axes, panels, strict=True):
        for estimator, look in looks(dataset).items():
            row = values.sel(estimator=estimator).values
            ax.plot(time, np.where(np.isinf(row), np.nan, row), label=estimator, **look.line())
        log_scale(ax)
        ax.set(xlabel=time_label(dataset), title=name, xlim=(time[0], time[-1]))
        grid(ax)
    axes[0].set_ylabel(_LABELS["position"])
    figure.suptitle(title(dataset))
    legend_outside(figure, axes[0])
    return figure
