"""Whether the covariances can be believed: NEES and NIS with chi-square bands."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from quietfix.diagrams.figures.shared.curves import draw_curves
from quietfix.diagrams.figures.shared.limits import Span, curve_span
from quietfix.diagrams.figures.shared.style import (
    grid,
    grouped_figure,
    legend_beside,
    log_scale,
    looks,
    time_label,
    title,
)
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
    figure, panels = grouped_figure(shown, sharex=True, sharey=True)
    finite = curve.values[np.isfinite(curve.values)]
    logarithmic = bool(finite.size and finite.max() > 10 * one)
    top = _TALLEST * one if logarithmic and finite.max() > _TALLEST * one else None
    span = Span(curve_span(list(curve.values)).low if logarithmic else None, top)
    for axes, group in zip(panels[:, 0], shown, strict=True):
        _bands(axes, time, *(part.sel(estimator=list(group)) for part in (lower, upper)))
        axes.axhline(one, color="0.4", linewidth=1.0)
        draw_curves(axes, time, curve, group, span)
        if logarithmic:
            log_scale(axes)
        axes.set(ylabel=label, xlim=(time[0], time[-1]) if time[-1] > time[0] else None)
        grid(axes)
        legend_beside(axes, others=len(shown) > 1)
    span.limit(panels[0, 0])
    panels[-1, 0].set_xlabel(time_label(dataset))
    figure.suptitle(title(dataset))
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
