"""TDOA and FDOA against time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from diagrams.figures.style import grid, new_figure

if TYPE_CHECKING:
    from diagrams.iq_replay import IqReplay

__all__ = ["draw_differences"]

_COLOURS = ("#0072b2", "#d55e00")


def draw_differences(result: IqReplay) -> Figure:
    """Draw both differences of every pair against time, a row for each pair, with the sigmas that are expected."""
    count = len(result.pairs)
    figure, panels = new_figure(height=1.2 + 3.0 * count, rows=count, columns=2, sharex=True, squeeze=False)
    for pair, row in zip(result.pairs, panels, strict=True):
        good = pair.good
        values = ((1e6 * pair.tdoa, 1e6 * pair.sigma_tdoa, "TDOA [us]"), (pair.fdoa, pair.sigma_fdoa, "FDOA [Hz]"))
        for axes, colour, (value, sigma, label) in zip(row, _COLOURS, values, strict=True):
            axes.errorbar(result.times[good], value[good], sigma[good], fmt="o-", ms=4, lw=0.8, capsize=2, color=colour)
            if not good.all():
                bottom = np.zeros(np.count_nonzero(~good))
                axes.plot(
                    result.times[~good],
                    bottom,
                    "x",
                    color="black",
                    ms=7,
                    mew=1.5,
                    transform=axes.get_xaxis_transform(),
                    clip_on=False,
                    zorder=5,
                    label="flagged",
                )
                axes.legend(frameon=False, loc="best")
            axes.set(ylabel=label, title=f"{pair.auxiliary} minus {pair.main}")
            axes.ticklabel_format(useOffset=False)
            grid(axes)
    for axes in panels[-1]:
        axes.set_xlabel("time [s]")
    figure.suptitle(f"Differences of arrival, {1e3 * result.length:.4g} ms each, with the sigmas expected")
    return figure
