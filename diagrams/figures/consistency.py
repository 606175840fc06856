"""Whether the covariances can be believed: NEES and NIS with chi-square bands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from quietfix.diagrams.figures.style import grid, legend_outside, log_scale, looks, new_figure, time_label, title
from quietfix.diagrams.statistics.consistency import nees_statistics, nis_statistics

__all__ = ["draw_consistency"]

_CONFIDENCE = 0.95
_TALLEST = 1000.0  # times what is consistent: a filter that is lost must not press the others into one line


def draw_consistency(dataset: xr.Dataset, kind: str, sums: Mapping[str, Any] | None = None) -> Figure:
    """Draw NEES or NIS per degree of freedom against time, with the band of a consistent filter.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result.
    kind : {'nees', 'nis'}
        Normalised estimation error squared, or normalised innovation squared.
    sums : mapping, optional
        Those over the trials, where they are known already.

    Returns
    -------
    matplotlib.figure.Figure
    """
    figure, axes = new_figure()
    time = dataset["time"].values
    if kind == "nees":
        found = nees_statistics(dataset, _CONFIDENCE, sums)
        freedom = found["freedom"]
        one = float(freedom[0])
        label = f"mean NEES over trials (consistent: {one:g})"
        if (freedom != one).any():  # estimators of different states
            per = freedom.where(freedom > 0)
            found, one = found.assign({part: found[part] / per for part in ("mean", "lower", "upper")}), 1.0
            label = "mean NEES over trials / components judged (consistent: 1)"
        curve, lower, upper = found["mean"], found["lower"], found["upper"]
    else:
        found = nis_statistics(dataset, _CONFIDENCE, sums)
        curve, lower, upper, one = found["ratio"], found["lower"], found["upper"], 1.0
        label = "sum of NIS / sum of degrees of freedom (consistent: 1)"
    shown = looks(dataset)
    _bands(axes, time, lower, upper)
    axes.axhline(one, color="0.4", linewidth=1.0)
    for name, look in shown.items():
        values = curve.sel(estimator=name).values
        values = np.where(np.isfinite(values), values, np.nan)
        largest = np.nanmax(values, initial=0.0)
        beyond = f" (off the scale, up to {largest:.0e})" if largest > _TALLEST * one else ""
        axes.plot(time, values, label=f"{name}{beyond}", **look.line())
    finite = curve.values[np.isfinite(curve.values)]
    if finite.size and finite.max() > 10 * one:
        log_scale(axes)
        if finite.max() > _TALLEST * one:
            axes.set_ylim(top=_TALLEST * one)
    axes.set(xlabel=time_label(dataset), ylabel=label, xlim=(time[0], time[-1]) if time[-1] > time[0] else None)
    grid(axes)
    figure.suptitle(title(dataset))
    legend_outside(figure, axes)
    return figure


def _bands(axes: Any, time: Any, lower: xr.DataArray, upper: xr.DataArray) -> None:
    """Fill each different band once; the narrower ones (more degrees of freedom) lie darker inside the wider."""
    drawn: list[Any] = []
    for low, high in zip(lower.values, upper.values, strict=True):
        if any(np.allclose(low, other, rtol=1e-9, equal_nan=True) for other in drawn):
            continue
        label = None if drawn else f"{100 * _CONFIDENCE:.0f} % band of a consistent filter"
        axes.fill_between(time, low, high, color="0.6", alpha=0.25, linewidth=0, label=label)
        drawn.append(low)
