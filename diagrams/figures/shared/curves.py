"""Curves of estimators against time: those of a group in colour, the others behind them in grey."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from quietfix.diagrams.figures.shared.limits import Span, mark_beyond
from quietfix.diagrams.figures.shared.style import OTHERS, Look

__all__ = ["draw_curves", "labelled", "never_started"]


def never_started(dataset: xr.Dataset, count: Any) -> dict[str, list[str]]:
    """Return what a legend says of trials that never started, by estimator, from their number (estimator,)."""
    trials = dataset.sizes["trial"]
    names = [str(name) for name in dataset["estimator"].values]
    return {name: [f"{int(n)} of {trials} never started"] for name, n in zip(names, count, strict=True) if n}


def labelled(name: str, remarks: Sequence[str]) -> str:
    """Return a name as a legend has it, with remarks below."""
    return "\n   ".join([name, *remarks])


def draw_curves(
    axes: Any,
    time: Any,
    curves: xr.DataArray,
    group: Mapping[str, Look],
    span: Span,
    remarks: Mapping[str, Sequence[str]] | None = None,
) -> None:
    """Draw the curves of a group, and where they leave the axes.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    time : array_like, shape (time,)
    curves : xarray.DataArray, dims (estimator, time)
        Of all estimators.
    group : mapping of str to Look
        Those that have a colour here.
    span : Span
        Of the axes.
    remarks : mapping of str to sequence of str, optional
        What the legend says of an estimator beside.
    """
    for name in map(str, curves["estimator"].values):
        if name not in group:
            values = curves.sel(estimator=name).values
            axes.plot(time, np.where(np.isfinite(values), values, np.nan), color=OTHERS, linewidth=1.0, zorder=1)
    for name, look in group.items():
        values = curves.sel(estimator=name).values
        finite = np.isfinite(values)
        told = [*(remarks or {}).get(name, ()), *span.told(values)]
        if not finite.any() and not told:
            told = ["none"]
        single = {"marker": look.marker, "markersize": look.markersize} if finite.sum() == 1 else {}
        axes.plot(time, np.where(finite, values, np.nan), label=labelled(name, told), **look.line(), **single)
        mark_beyond(axes, time, values, span, look.color)
