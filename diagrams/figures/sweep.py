"""What a mismatch costs: RMSE, RMSE over bound and NEES against the number that was varied."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from quietfix.diagrams.figures.style import grid, legend_outside, log_scale, looks, new_figure

__all__ = ["draw_sweep"]

_PANELS = (
    ("rmse_position_m", "position RMSE [m]"),
    ("efficiency", "RMSE / bound"),
    ("nees_per_state", "NEES / states"),
)


def draw_sweep(found: Mapping[str, Any], geometric: bool = False) -> Figure:
    """Draw the curves of a sweep with their confidence bands.

    Parameters
    ----------
    found : mapping
        As `quietfix.diagrams.experiments.sweep.sweep_statistics` gives it.
    geometric : bool
        Whether the values are spaced by a factor.

    Returns
    -------
    matplotlib.figure.Figure
    """
    rows, values = found["estimators"], np.array(found["values"])
    shown = looks(xr.Dataset(coords={"estimator": list(rows)}))
    panels = [p for p in _PANELS if any(e["value"] is not None for row in rows.values() for e in row[p[0]])]
    figure, axes = new_figure(2.2 + 2.7 * len(panels), len(panels), 1, sharex=True, squeeze=False)
    for (metric, label), axis in zip(panels, axes[:, 0], strict=True):
        for name, look in shown.items():
            centre, low, high = (
                np.array([np.nan if e[part] is None else e[part] for e in rows[name][metric]], dtype=float)
                for part in ("value", "low", "high")
            )
            axis.fill_between(values, low, high, color=look.color, alpha=0.18, linewidth=0)
            axis.plot(values, centre, label=name, marker="o", markersize=5, **look.line())
        if metric != "rmse_position_m":
            axis.axhline(1.0, color="0.4", linewidth=1.0, zorder=0)
        if metric == "nees_per_state":
            _consistent(axis, values, next(iter(rows.values()))["nees_band"])
        log_scale(axis)
        axis.set_ylabel(label)
        grid(axis)
    bottom = axes[-1, 0]
    if geometric:
        bottom.set_xscale("log")
        bottom.set_xticks(values, [f"{value:g}" for value in values])
        bottom.xaxis.set_minor_locator(NullLocator())
    bottom.set_xlabel(found["key"])
    variant = f":{found['variant']}" if found["variant"] else ""
    times = sorted(set(found["time_s"]))
    when = f"{times[0]:g} s" if len(times) == 1 else f"{times[0]:g} to {times[-1]:g} s"
    figure.suptitle(f"{found['system']}{variant}, at {when}, {found['trials']} trials, seed {found['seed']}")
    percent = f"{100 * found['confidence']:g} %"
    extra = [
        Line2D([], [], color=next(iter(shown.values())).color, alpha=0.2, linewidth=8, label=f"{percent} interval"),
        Line2D([], [], color="0.6", alpha=0.5, linewidth=8, label=f"{percent} band of a\nconsistent filter"),
    ]
    legend_outside(figure, axes[0, 0], extra)
    figure.align_ylabels()
    return figure


def _consistent(axis: Any, values: Any, bands: list[dict[str, float] | None]) -> None:
    low, high = (np.array([np.nan if b is None else b[part] for b in bands]) for part in ("low", "high"))
    axis.fill_between(values, low, high, color="0.6", alpha=0.3, linewidth=0)
