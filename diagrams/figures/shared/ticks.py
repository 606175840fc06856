"""Numbers along axes of places, as one reads them: a room in metres, longitudes within half a turn."""

from __future__ import annotations

from typing import Any

import numpy as np

__all__ = ["plain_ticks"]

_MOST = 6  # numbers along the horizontal axis that have room beside each other
_KM = 1e3  # m


def plain_ticks(axes: Any) -> None:
    """Write the numbers along the axes of places.

    Axes in kilometres that end within one of 0 are told in metres; longitudes lie in (-180, 180], though axes run on
    across the date line. What is drawn keeps its units.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        With its labels, and all that is drawn on it.
    """
    axes.locator_params(axis="x", nbins=_MOST)
    both = (axes.xaxis, axes.yaxis)
    ends = np.abs([axes.get_xlim(), axes.get_ylim()])
    if ends.max() < 1 and all(axis.get_label_text().endswith("[km]") for axis in both):
        for axis in both:
            axis.set_label_text(axis.get_label_text().replace("[km]", "[m]"))
            axis.set_major_formatter(lambda place, _: _written(_KM * place))
    for axis in both:
        if axis.get_label_text().startswith("longitude"):
            axis.set_major_formatter(lambda degrees, _: _written(180 - (180 - degrees) % 360))


def _written(number: float) -> str:
    return f"{number:.6g}".replace("-", "\N{MINUS SIGN}")
