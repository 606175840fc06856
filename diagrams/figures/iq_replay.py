"""TDOA and FDOA against time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from diagrams.figures.style import grid, legend_outside, new_figure

if TYPE_CHECKING:
    from diagrams.iq_replay import IqReplay

__all__ = ["draw_differences"]

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")


def draw_differences(result: IqReplay) -> Figure:
    """Draw both differences of every pair against time, with the sigmas that the samples let expect."""
    figure, (upper, lower) = new_figure(height=7, rows=2, sharex=True)
    for k, pair in enumerate(result.pairs):
        good, colour = pair.good, _COLOURS[k % len(_COLOURS)]
        rows = ((upper, 1e6 * pair.tdoa, 1e6 * pair.sigma_tdoa), (lower, pair.fdoa, pair.sigma_fdoa))
        for axes, value, sigma in rows:
            axes.errorbar(
                result.times[good],
                value[good],
                sigma[good],
                fmt="o-",
                ms=4,
                lw=0.8,
                capsize=2,
                color=colour,
                label=f"{pair.auxiliary}\nminus {pair.main}",
            )
        if not good.all():
            upper.plot(
                result.times[~good],
                np.zeros(np.count_nonzero(~good)),
                "x",
                color=colour,
                transform=upper.get_xaxis_transform(),
                clip_on=False,
                label="flagged" if k == 0 else None,
            )
    upper.set_ylabel("TDOA [us]")
    lower.set(ylabel="FDOA [Hz]", xlabel="time [s]")
    for axes in (upper, lower):
        axes.ticklabel_format(useOffset=False)
        grid(axes)
    figure.suptitle(f"Differences of arrival, {1e3 * result.length:.4g} ms each, with sigma")
    legend_outside(figure, upper)
    return figure
