"""What all figures share: size, colours, titles, saving."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import xarray as xr
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.ticker import LogFormatter

__all__ = [
    "Look",
    "PlainLog",
    "grid",
    "legend_outside",
    "log_scale",
    "looks",
    "new_figure",
    "save",
    "time_label",
    "title",
]

_DPI = 100
_WIDTH = 12.0  # inches: 1200 pixels
_FONT: Any = {"font.size": 13, "axes.titlesize": 14, "figure.titlesize": 15, "legend.fontsize": 11}
# Okabe and Ito, *Color universal design* (2008): told apart with every kind of colour vision, on white.
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
_DASHES: tuple[Any, ...] = ("-", (0, (6, 2)), (0, (2, 1.5)), (0, (7, 2, 1.5, 2)), "-", (0, (6, 2)), (0, (2, 1.5)))
_WIDTHS = (3.2, 2.4, 2.0, 2.0, 2.0, 2.0, 2.0)  # the first is thick, so that one that lies on it shows both

_MARKERS, _HATCHES = (".", "x", "^"), ("", "///", "...")


class Look(NamedTuple):
    """How an estimator is drawn, in every figure of a study."""

    color: str
    linestyle: Any
    linewidth: float
    marker: str
    hatch: str

    def line(self) -> dict[str, Any]:
        """Return the keywords of a line."""
        return {"color": self.color, "linestyle": self.linestyle, "linewidth": self.linewidth}

    def bar(self) -> dict[str, Any]:
        """Return the keywords of a bar."""
        return {"color": self.color, "hatch": self.hatch, "edgecolor": "white", "linewidth": 0}

    def dots(self) -> dict[str, Any]:
        """Return the keywords of a cloud of dots."""
        return {"color": self.color, "marker": self.marker, "markersize": 5, "linestyle": "none"}


def looks(dataset: xr.Dataset) -> dict[str, Look]:
    """Return the look of each estimator, by its place in the result."""
    names = [str(name) for name in dataset["estimator"].values]
    size = len(_COLOURS)
    # from the eighth on the colours come again, with the next dashes, marker and hatch, and thin
    return {
        name: Look(
            _COLOURS[i % size],
            _DASHES[(i + i // size) % size],
            _WIDTHS[min(i, size - 1)],
            _MARKERS[i // size % len(_MARKERS)],
            _HATCHES[i // size % len(_HATCHES)],
        )
        for i, name in enumerate(names)
    }


def new_figure(height: float = 6.5, rows: int = 1, columns: int = 1, **keywords: Any) -> tuple[Figure, Any]:
    """Return a figure 1200 pixels wide and its axes; no pyplot, so nothing outlives it."""
    with rc_context(_FONT):
        figure = Figure(figsize=(_WIDTH, height), dpi=_DPI, layout="constrained")
        return figure, figure.subplots(rows, columns, **keywords)


def title(dataset: xr.Dataset) -> str:
    """Return which study it is."""
    variant = dataset.attrs.get("variant")
    name = dataset.attrs.get("system", "study") + (f":{variant}" if variant else "")
    trials = dataset.sizes["trial"]
    return f"{name}, {trials} trial{'s' * (trials != 1)}, seed {dataset.attrs.get('seed', '?')}"


class PlainLog(LogFormatter):
    """2000 instead of 2 x 10^3, at those ticks that Matplotlib would label."""

    def __call__(self, x: float, pos: int | None = None) -> str:
        """Return the label of a tick."""
        return f"{x:g}" if super().__call__(x, pos) else ""


def log_scale(axes: Any) -> None:
    """Make the vertical axis logarithmic, with plain numbers beside it."""
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(PlainLog())
    axes.yaxis.set_minor_formatter(PlainLog(minor_thresholds=(2, 0.5)))


def grid(axes: Any) -> None:
    """Draw a light grid below the data."""
    axes.grid(True, which="major", color="0.85", linewidth=0.8)
    axes.grid(True, which="minor", color="0.93", linewidth=0.5)
    axes.set_axisbelow(True)


def time_label(dataset: xr.Dataset) -> str:
    """Return what stands below the axis along which a trial goes on."""
    return str(dataset.attrs.get("axis", "time [s]"))


def legend_outside(figure: Figure, axes: Any, extra: Sequence[Any] = (), **keywords: Any) -> None:
    """Put the legend to the right of the axes, where it hides nothing, with `extra` entries below."""
    with rc_context(_FONT):
        handles = [*axes.get_legend_handles_labels()[0], *extra]
        figure.legend(handles=handles, loc="outside right upper", frameon=False, **keywords)


def save(figure: Figure, path: Path) -> Path:
    """Save a figure and return its path."""
    with rc_context(_FONT):
        figure.savefig(path)
    return path
