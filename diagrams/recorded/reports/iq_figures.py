"""TDOA and FDOA against time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from quietfix.diagrams.figures.shared.style import grid, new_figure

__all__ = ["draw_differences"]

Array = NDArray[np.float64]

_COLOURS = ("#0072b2", "#d55e00")


def draw_differences(pairs: Mapping[str, Sequence[tuple[str, Array, Array]]], times: Array, length: float) -> Figure:
    """Draw both differences of every pair against time, a row for each pair, with the sigmas that are expected.

    Parameters
    ----------
    pairs : mapping of str to two of (str, ndarray, ndarray)
        By the pair's name, each difference: name and unit, value and sigma (times,); NaN where it is flagged.
    times : ndarray, shape (times,)
        [s]
    length : float
        What each was integrated over [s].
    """
    count = len(pairs)
    figure, panels = new_figure(height=1.2 + 3.0 * count, rows=count, columns=2, sharex=True, squeeze=False)
    for (name, differences), row in zip(pairs.items(), panels, strict=True):
        for axes, colour, (label, value, sigma) in zip(row, _COLOURS, differences, strict=True):
            good = np.isfinite(value)
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
            axes.set(ylabel=label, title=name)
            axes.ticklabel_format(useOffset=False)
            grid(axes)
    for axes in panels[-1]:
        axes.set_xlabel("time [s]")
    figure.suptitle(f"Differences of arrival, {1e3 * length:.4g} ms each, with the sigmas expected")
    return figure
