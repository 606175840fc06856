"""Figure of DopTrack."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from quietfix.diagrams.figures.shared.limits import curve_span, mark_beyond
from quietfix.diagrams.figures.shared.style import grid, grouped_figure, legend_beside, log_scale, looks_of

__all__ = ["draw_station_error"]

Array = NDArray[np.float64]


def draw_station_error(errors: Mapping[str, Array], title: str) -> Figure:
    """Draw how far off the station is after each pass.

    Parameters
    ----------
    errors : mapping of str to ndarray, shape (passes,)
        Horizontal error by estimator [m].
    title : str
    """
    shown = looks_of(list(errors))
    figure, panels = grouped_figure(shown, sharex=True, sharey=True)
    span = curve_span([1e-3 * error for error in errors.values()])
    for axes, group in zip(panels[:, 0], shown, strict=True):
        for name, look in group.items():
            error = 1e-3 * errors[name]
            passes = np.arange(1, error.size + 1)
            label = "\n   ".join([name, *span.told(error)])
            axes.plot(passes, error, marker=look.marker, markersize=6, label=label, **look.line())
            mark_beyond(axes, passes, error, span, look.color)
        log_scale(axes)
        axes.set_ylabel("horizontal error of the station [km]")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        grid(axes)
        legend_beside(axes)
    span.limit(panels[0, 0])
    panels[-1, 0].set_xlabel("passes used")
    figure.suptitle(title)
    return figure
