"""The swap matrix as a figure: one row per estimator, one panel per question."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter

from quietfix.diagrams.figures.shared.style import grid, new_figure

__all__ = ["draw_comparison"]

_COLOUR, _WINNER, _FAINT = "#0072b2", "#d55e00", "0.55"
_WIDEST = 1e4  # times the smallest: what is further off is drawn at the edge


def draw_comparison(found: Mapping[str, Any]) -> Figure:
    """Draw RMSE, RMSE over bound, NEES and cost of every estimator, with their intervals.

    Parameters
    ----------
    found : mapping
        As `quietfix.diagrams.experiments.comparison.comparison_statistics` gives it.

    Returns
    -------
    matplotlib.figure.Figure
    """
    rows = found["estimators"]
    names = list(rows)
    figure, panels = new_figure(max(4.0, 1.9 + 0.4 * len(names)), 1, 4, sharey=True, width_ratios=(1.5, 1.5, 1, 1))
    percent = f"{100 * found['confidence']:g} %"
    best = found["best"]
    when = "the end of each track" if found["time_s"] is None else f"{found['time_s']:g} s"
    beyond = _dots(
        panels[0],
        [rows[n]["rmse_position_m"] for n in names],
        [_won(best["rmse_position_m"], n) for n in names],
        f"position RMSE at {when} [m]",
    )
    beyond += _dots(
        panels[1],
        [rows[n]["efficiency"] for n in names],
        [False] * len(names),
        "RMSE / bound",
        hollow=[not rows[n]["efficiency_means_something"] for n in names],
    )
    beyond += _dots(panels[2], [rows[n]["nees_per_state"] for n in names], [False] * len(names), "NEES / states")
    beyond += _dots(panels[3], [_bare(rows[n]["cost_us"]) for n in names], [False] * len(names), "us per step")
    for panel in panels[1:3]:
        panel.axvline(1.0, color="0.4", linewidth=1.0, zorder=0)
    bands = [rows[n]["nees_band"] for n in names]
    for i, band in enumerate(bands):
        if band is not None:
            panels[2].fill_betweenx([i - 0.4, i + 0.4], band["low"], band["high"], color="0.6", alpha=0.3, linewidth=0)
    panels[0].set_yticks(range(len(names)), [n if rows[n]["causal"] else f"{n} (not causal)" for n in names])
    panels[0].set_ylim(len(names) - 0.5, -0.5)
    variant = f":{found['variant']}" if found["variant"] else ""
    figure.suptitle(f"{found['system']}{variant}, {found['trials']} trials, seed {found['seed']}")
    entries = [_entry(_COLOUR, f"value and {percent} interval")]
    if any(_won(best["rmse_position_m"], n) for n in names):
        entries.append(_entry(_WINNER, "significantly the smallest"))
    if any(rows[n]["efficiency"]["value"] is not None and not rows[n]["efficiency_means_something"] for n in names):
        entries.append(_entry(_COLOUR, "truth moves unlike the filter's model: no efficiency", hollow=True))
    if beyond:
        words = f"infinite or off the scale: {beyond}"
        entries.append(Line2D([], [], color=_FAINT, marker=">", linestyle="none", label=words))
    entries.append(Line2D([], [], color="0.6", alpha=0.4, linewidth=8, label=f"{percent} band of a consistent filter"))
    figure.legend(handles=entries, loc="outside lower center", ncols=2, frameon=False, fontsize=11)
    return figure


def _won(best: Mapping[str, Any] | None, name: str) -> bool:
    return bool(best and best["significant"] and best["name"] == name)


def _bare(value: float | None) -> dict[str, float | None]:
    return {"value": value, "low": value, "high": value}


def _entry(colour: str, label: str, hollow: bool = False) -> Line2D:
    face = "white" if hollow else colour
    return Line2D([], [], color=colour, marker="o", markerfacecolor=face, linewidth=1.5, label=label)


def _dots(axes: Any, entries: list[Any], won: list[bool], label: str, hollow: list[bool] | None = None) -> int:
    """Draw one panel, a dot and its interval per row, on a logarithmic axis; return how many are off the scale."""
    values = [entry["value"] for entry in entries if entry["value"]]
    axes.set_xlabel(label)
    if not values:
        axes.text(0.5, 0.5, "none", transform=axes.transAxes, ha="center", color=_FAINT)
        axes.set_xticks([])
        return 0
    outside = 0
    edge = _WIDEST * min(values)
    for i, (entry, first) in enumerate(zip(entries, won, strict=True)):
        value = entry["value"]
        if value is None or value > edge:
            axes.plot(1.0, i, ">", color=_FAINT, clip_on=False, zorder=3, transform=axes.get_yaxis_transform())
            outside += 1
            continue
        colour = _WINNER if first else _COLOUR
        low, high = (min(x, edge) if x is not None and np.isfinite(x) else edge for x in (entry["low"], entry["high"]))
        axes.plot([low, high], [i, i], color=colour, linewidth=2.0)
        face = "white" if hollow is not None and hollow[i] else colour
        axes.plot([value], [i], "o", color=colour, markerfacecolor=face, markersize=7)
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    decades = np.log10(high / low)
    if decades < 0.7:  # hardly any round power in it
        axes.xaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 5, 10]))
    else:
        axes.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5) if decades < 1.8 else (1,), numticks=6))
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(axis="x", which="both", labelsize=10)
    grid(axes)
    return outside
