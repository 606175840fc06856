"""What is known of the state at the start against time, and of what the worst known direction consists."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from quietfix.diagrams.figures.shared.style import COLOURS, PlainLog, grid, log_scale, new_figure, save

__all__ = ["draw_observability", "observe_figures"]

_LARGEST = 1e6  # of the prior; what is known worse is not drawn


def _short(head: str, names: Sequence[str], most: int = 6) -> str:
    """Return names in a row, the first few of many."""
    shown = ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")
    return f"{head}: {shown}" if head else shown


def draw_observability(one: Mapping[str, Any], time_s: Sequence[float], title: str) -> Figure:
    """Draw the standard deviation of every direction, and the worst direction's components.

    Parameters
    ----------
    one : mapping
        A set of measurements as ``summary.json`` of ``quietfix observe`` holds it under ``sets``: ``estimators``,
        ``rows``, ``components``, and over the epochs ``sigma`` and ``weakest``.
    time_s : sequence of float
        Epochs [s], at least one.
    title : str
        System and variant.
    """
    figure, (above, below) = new_figure(height=9.0, rows=2, sharex=True, height_ratios=(3, 2))
    elapsed = np.asarray(time_s, dtype=float) - time_s[0]
    step = elapsed[1] if elapsed.size > 1 else 1.0
    time = elapsed + step  # the first epoch has its place on a logarithmic axis as well
    sigma, components = np.array(one["sigma"], dtype=float), one["components"]
    n = len(components)
    style = "." if elapsed.size < 3 else "-"
    for i in range(n):
        values = np.where(sigma[:, i] < _LARGEST, sigma[:, i], np.nan)
        worst = i == n - 1
        above.plot(
            time,
            values,
            style,
            color="#d55e00" if worst else "#0072b2",
            alpha=1.0 if worst else 0.3 + 0.6 * i / n,
            linewidth=2.6 if worst else 1.6,
            label="worst known direction" if worst else "other directions" if i == 0 else None,
        )
    above.axhline(1.0, color="0.3", linestyle=(0, (4, 2)), linewidth=1.3, label="as good as the prior")
    above.set_xscale("log")
    above.xaxis.set_major_formatter(PlainLog())
    log_scale(above)
    above.set_ylabel("sigma from measurements / prior")
    grid(above)
    above.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=10, frameon=False)
    shares = np.array(one["weakest"], dtype=float)
    order = [i for i in np.argsort(-shares.max(axis=0)) if shares[:, i].max() > 0.05][: len(COLOURS)]
    rest = 1 - shares[:, order].sum(axis=-1)
    if elapsed.size > 1:
        below.stackplot(time, shares[:, order].T, labels=[components[i] for i in order], colors=COLOURS, step="post")
        if rest.max() > 0.01:
            below.fill_between(time, 1 - rest, 1, color="0.8", step="post", label="others, below 5 % each")
    else:
        below.bar([time[0]], [1.0], width=0.1, color="none")
        bottom = 0.0
        for i, color in zip(order, COLOURS, strict=False):
            below.bar([time[0]], shares[0, i], bottom=bottom, width=0.1, label=components[i], color=color)
            bottom += shares[0, i]
    below.set(xlabel=f"time since the first epoch, plus one period ({step:g} s)", ylabel="worst direction consists of")
    below.set_ylim(0, 1)
    below.legend(loc="center left", bbox_to_anchor=(1.01, 0.5), fontsize=10, frameon=False)
    if time.size > 1:
        below.set_xlim(time[0], time[-1])
    ranged = f"; ranges are from {one['ranges_from']}" if one["ranges_from"] else ""
    lines = [_short(title, one["estimators"]), f"state at the start from {_short('', one['rows'])}"]
    figure.suptitle("\n".join([*lines, f"alone: no prior, no process noise{ranged}"]), fontsize=13)
    return figure


def observe_figures(summary: Mapping[str, Any], title: str, folder: Path | str) -> list[Path]:
    """Draw and save a figure per set of measurements of a ``summary.json``, ``observability_ESTIMATOR.png``."""
    return [
        save(
            draw_observability(one, summary["time_s"], title),
            Path(folder) / f"observability_{one['estimators'][0]}.png",
        )
        for one in summary["sets"]
    ]
