"""TDOA and FDOA against time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from quietfix.diagrams.figures.style import grid, new_figure
from quietfix.diagrams.parts.iq_comparison import PairResult

__all__ = ["draw_differences"]

_COLOURS = ("#0072b2", "#d55e00")


def draw_differences(pairs: Sequence[PairResult], times: NDArray[np.float64], length: float) -> Figure:
    """Draw both differences of every pair against time [s], a row for each pair, with the sigmas that are expected.

    `length` is what each was integrated over [s].
    """
    count = len(pairs)
    figure, panels = new_figure(height=1.2 + 3.0 * count, rows=count, columns=2, sharex=True, squeeze=False)
    for pair, row in zip(pairs, panels, strict=True):
        good = pair.good
        values = ((1e6 * pair.tdoa, 1e6 * pair.sigma_tdoa, "TDOA [us]"), (pair.fdoa, pair.sigma_fdoa, "FDOA [Hz]"))
        for axes, colour, (value, sigma, label) in zip(row, _COLOURS, values, strict=True):
            axes.errorbar(times[good], value[good], sigma[good], fmt="o-", ms=4, lw=0.8, capsize=2, color=colour)
            if not good.all():
                bottom = np.zeros(np.count_nonzero(~good))
                axes.plot(
                    times[~good],
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
    figure.suptitle(f"Differences of arrival, {1e3 * length:.4g} ms each, with the sigmas expected")
    return figure
