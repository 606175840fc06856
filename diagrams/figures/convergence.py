"""How long the estimators need."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from quietfix.diagrams.figures.shared.curves import labelled
from quietfix.diagrams.figures.shared.style import Look, grid, grouped_figure, legend_beside, looks, title
from quietfix.diagrams.statistics.metrics import convergence_time

__all__ = ["draw_convergence"]

_FRACTIONS = (0.75, 0.5, 1 / 3)
_WIDTH = 0.86  # of the bars of a share together


def draw_convergence(
    dataset: xr.Dataset, curve: xr.DataArray, remarks: Mapping[str, Sequence[str]] | None = None
) -> Figure:
    """Draw the times from which the position RMSE stays below shares of what it was at the start.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result.
    curve : xarray.DataArray, dims (estimator, time)
        Position RMSE [m]; see `quietfix.diagrams.statistics.metrics.convergence_time`.
    remarks : mapping of str to sequence of str, optional
        What the legend says of an estimator beside its name.

    Returns
    -------
    matplotlib.figure.Figure
    """
    shown = looks(dataset)
    figure, panels = grouped_figure(shown, sharex=True, sharey=True)
    time = dataset["time"].values
    for axes, group in zip(panels[:, 0], shown, strict=True):
        for i, (name, look) in enumerate(group.items()):
            place = (i - (len(group) - 1) / 2) * _WIDTH / len(group)
            label = labelled(name, (remarks or {}).get(name, ()))
            _bars(axes, time, curve.sel(estimator=name).values, place, _WIDTH / len(group), look, label)
        axes.set_xticks(range(len(_FRACTIONS)), [f"{100 * fraction:.0f} %" for fraction in _FRACTIONS])
        axes.set(ylabel="convergence time [s]", ylim=(time[0], time[0] + 1.1 * max(time[-1] - time[0], 1e-9)))
        grid(axes)
        legend_beside(axes)
    panels[-1, 0].set_xlabel("position RMSE stays, to the end, below this share of the RMSE at the start")
    figure.suptitle(title(dataset))
    return figure


def _bars(axes: Any, time: Any, values: Any, place: float, width: float, look: Look, label: str) -> None:
    """Draw a bar for each share, with its number above."""
    places = np.arange(len(_FRACTIONS)) + place
    needed = [convergence_time(time, values, fraction=fraction) for fraction in _FRACTIONS]
    axes.bar(places, np.nan_to_num(needed), width * 0.92, label=label, **look.bar())
    for x, t in zip(places, needed, strict=True):
        reached = not math.isnan(t)
        axes.annotate(
            f"{t:.4g}" if reached else "not reached",
            (x, t if reached else time[0]),
            xytext=(0, 3),
            textcoords="offset points",
            ha="center",
            va="bottom",
            rotation=0 if reached else 90,
            fontsize=10,
            color="black",
        )
