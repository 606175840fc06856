"""What a mismatch costs: RMSE, RMSE over bound and NEES against the number that was varied."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator
from matplotlib.transforms import ScaledTranslation

from quietfix.diagrams.figures.shared.curves import labelled
from quietfix.diagrams.figures.shared.limits import curve_span, mark_beyond
from quietfix.diagrams.figures.shared.style import (
    OTHERS,
    Look,
    grid,
    legend_above,
    legend_beside,
    log_scale,
    looks_of,
    new_figure,
)

__all__ = ["draw_sweep"]

_INTERVAL = ("value", "low", "high")
_APART = 5.0  # points between the estimators of a value
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
    shown = looks_of(list(rows))
    panels = [p for p in _PANELS if any(e["value"] is not None for row in rows.values() for e in row[p[0]])]
    figure, every = new_figure(
        2.8 + 2.7 * len(panels), len(panels), len(shown), sharex=True, sharey="row", squeeze=False
    )
    for group, axes in zip(shown, every.T, strict=True):
        for (metric, label), axis in zip(panels, axes, strict=True):
            _draw(axis, values, rows, metric, group)
            if axis in every[:, 0]:
                axis.set_ylabel(label)
        bottom = axes[-1]
        if geometric:
            bottom.set_xscale("log")
            bottom.set_xticks(values, [f"{value:g}" for value in values])
            bottom.xaxis.set_minor_locator(NullLocator())
        bottom.set_xlabel(found["key"])
    variant = f":{found['variant']}" if found["variant"] else ""
    times = sorted(set(found["time_s"]))
    when = f"{times[0]:g} s" if len(times) == 1 else f"{times[0]:g} to {times[-1]:g} s"
    figure.suptitle(f"{found['system']}{variant}, at {when}, {found['trials']} trials, seed {found['seed']}")
    _legends(every, f"{100 * found['confidence']:g} %", len(shown) > 1)
    figure.align_ylabels()
    return figure


def _draw(axis: Any, values: Any, rows: Mapping[str, Any], metric: str, group: Mapping[str, Look]) -> None:
    """Draw one panel: the estimators of a group with their intervals, the others in grey."""
    curves = {name: _parts(row[metric]) for name, row in rows.items()}
    span = curve_span([centre for centre, _, _ in curves.values()])
    for name, (centre, _, _) in curves.items():
        if name not in group:
            axis.plot(values, centre, color=OTHERS, linewidth=1.0, zorder=1)
    for i, (name, look) in enumerate(group.items()):
        centre, low, high = curves[name]
        # a little beside each other, so that none hides another's interval
        beside = ScaledTranslation(_APART * (i - (len(group) - 1) / 2) / 72, 0, axis.figure.dpi_scale_trans)
        place = axis.transData + beside
        axis.vlines(values, low, high, color=look.color, linewidth=1.6, alpha=0.75, transform=place)
        dots = {"marker": look.marker, "markersize": look.markersize + 2}
        missing = np.count_nonzero(np.isnan(centre))
        none = [f"infinite or unknown at {missing} value{'' if missing == 1 else 's'}"] if missing else []
        label = labelled(name, [*none, *span.told(centre, "value")])
        axis.plot(values, centre, label=label, transform=place, **dots, **look.line())
        mark_beyond(axis, values, centre, span, look.color)
    _include(axis, [part for name in group for part in curves[name]], values)
    if metric != "rmse_position_m":
        axis.axhline(1.0, color="0.4", linewidth=1.0, zorder=0)
    if metric == "nees_per_state":
        _consistent(axis, values, next(iter(rows.values()))["nees_band"])
    log_scale(axis)
    span.limit(axis)
    grid(axis)


def _include(axis: Any, parts: Sequence[Any], values: Any) -> None:
    """Let the axes hold what is drawn: Matplotlib leaves out what is moved aside."""
    known = np.concatenate([part[np.isfinite(part) & (part > 0)] for part in parts])
    if known.size:
        corners = np.array([[values.min(), known.min()], [values.max(), known.max()]])
        axis.update_datalim(corners)
        axis.autoscale_view()


def _parts(entries: Sequence[Mapping[str, float | None]]) -> tuple[Any, Any, Any]:
    """Return values and the ends of their intervals."""
    numbers = [[np.nan if entry[part] is None else entry[part] for entry in entries] for part in _INTERVAL]
    value, low, high = np.array(numbers, dtype=float)
    return value, low, high


def _legends(every: Any, percent: str, several: bool) -> None:
    extra = [
        Line2D([], [], color="0.4", marker="|", markersize=12, linestyle="none", label=f"{percent} interval"),
        Line2D([], [], color="0.6", alpha=0.5, linewidth=8, label=f"{percent} band of a\nconsistent filter"),
    ]
    for axis in every[0]:
        # beside each other there is no room beside them
        (legend_above if several else legend_beside)(axis, extra, several)


def _consistent(axis: Any, values: Any, bands: list[dict[str, float] | None]) -> None:
    low, high = (np.array([np.nan if b is None else b[part] for b in bands]) for part in ("low", "high"))
    axis.fill_between(values, low, high, color="0.6", alpha=0.3, linewidth=0)
