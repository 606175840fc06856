"""How long the estimators need."""

from __future__ import annotations

import math

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from quietfix.diagrams.figures.style import grid, legend_outside, looks, new_figure, title
from quietfix.diagrams.statistics.metrics import convergence_time

__all__ = ["draw_convergence"]

_FRACTIONS = (0.75, 0.5, 1 / 3)
_FEW = 8  # estimators; numbers of more stand upright, for the bars are narrow


def draw_convergence(dataset: xr.Dataset, curve: xr.DataArray) -> Figure:
    """Draw the times from which the position RMSE stays below shares of what it was at the start.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result.
    curve : xarray.DataArray, dims (estimator, time)
        Position RMSE [m]; see `quietfix.diagrams.statistics.metrics.convergence_time`.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure, axes = new_figure()
    time, shown = dataset["time"].values, looks(dataset)
    width = 0.8 / len(shown)
    for i, (name, look) in enumerate(shown.items()):
        values = curve.sel(estimator=name).values
        places = np.arange(len(_FRACTIONS)) + (i - (len(shown) - 1) / 2) * width
        needed = [convergence_time(time, values, fraction=fraction) for fraction in _FRACTIONS]
        axes.bar(places, np.nan_to_num(needed), width * 0.92, label=name, **look.bar())
        for x, t in zip(places, needed, strict=True):
            reached = not math.isnan(t)
            axes.annotate(
                f"{t:.0f}" if reached else "not reached",
                (x, t if reached else 0.0),
                xytext=(0, 3),
                textcoords="offset points",
                ha="center",
                va="bottom",
                rotation=0 if reached and len(shown) <= _FEW else 90,
                fontsize=11 if len(shown) <= _FEW else 9,
                color="black" if reached else look.color,
            )
    axes.set_xticks(range(len(_FRACTIONS)), [f"{100 * fraction:.0f} %" for fraction in _FRACTIONS])
    axes.set(
        xlabel="position RMSE stays, to the end, below this share of the RMSE at the start",
        ylabel="convergence time [s]",
        ylim=(0.0, 1.08 * (time[-1] - time[0]) + time[0]),
    )
    grid(axes)
    figure.suptitle(title(dataset))
    legend_outside(figure, axes)
    return figure
