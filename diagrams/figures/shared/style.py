"""The manner of all figures: size, colours, titles, saving."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import xarray as xr
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import LogFormatter
from numpy.typing import NDArray

__all__ = [
    "COLOURS",
    "OTHERS",
    "Look",
    "PlainLog",
    "grid",
    "grouped_figure",
    "groups",
    "legend_above",
    "legend_beside",
    "legend_outside",
    "log_scale",
    "looks",
    "looks_of",
    "new_figure",
    "save",
    "time_label",
    "title",
]

_DPI = 100
_WIDTH = 12.0  # inches: 1200 pixels
_FONT: Any = {"font.size": 13, "axes.titlesize": 14, "figure.titlesize": 15, "legend.fontsize": 11}
# Okabe and Ito, *Color universal design* (2008): told apart with every kind of colour vision, on white.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
"""Of what stands side by side on axes, the first one first."""
OTHERS = "0.82"
"""Of what stands behind it, to compare with."""
_DASHES: tuple[Any, ...] = ("-", (0, (6, 2)), (0, (2, 1.5)), (0, (7, 2, 1.5, 2)), "-", (0, (6, 2)), (0, (2, 1.5)))
_WIDTHS = (3.2, 2.4, 2.0, 2.0, 2.0, 2.0, 2.0)  # the first is thick, so that one that lies on it shows both
_MARKERS, _SIZES = ("o", "x", "^", "+", "s", "v", "d"), (4, 5, 4, 6, 3.5, 4, 4)


class Look(NamedTuple):
    """How an estimator is drawn, in every figure of a study."""

    color: str
    linestyle: Any
    linewidth: float
    marker: str
    markersize: float

    def line(self) -> dict[str, Any]:
        """Return the keywords of a line."""
        return {"color": self.color, "linestyle": self.linestyle, "linewidth": self.linewidth}

    def bar(self) -> dict[str, Any]:
        """Return the keywords of a bar."""
        return {"color": self.color, "edgecolor": "white", "linewidth": 0}

    def dots(self) -> dict[str, Any]:
        """Return the keywords of a cloud of dots."""
        return {
            "color": self.color,
            "marker": self.marker,
            "markersize": self.markersize,
            "markeredgewidth": 1.0 if self.marker in "x+" else 0.0,
            "linestyle": "none",
        }


def groups(names: Sequence[str]) -> list[list[str]]:
    """Return names in groups that have a colour for each, as alike in size as can be, in their order."""
    count = max(1, -(-len(names) // len(COLOURS)))
    each, more = divmod(len(names), count)
    ends = [each * (i + 1) + min(i + 1, more) for i in range(count)]
    return [list(names[begin:end]) for begin, end in pairwise([0, *ends])]


def looks_of(names: Sequence[str]) -> list[dict[str, Look]]:
    """Return the look of each name, group by group: no two of a group share a colour."""
    return [
        {name: Look(COLOURS[i], _DASHES[i], _WIDTHS[i], _MARKERS[i], _SIZES[i]) for i, name in enumerate(group)}
        for group in groups(names)
    ]


def looks(dataset: xr.Dataset) -> list[dict[str, Look]]:
    """Return the look of each estimator, group by group, by its place in the result."""
    return looks_of([str(name) for name in dataset["estimator"].values])


def grouped_figure(
    shown: Sequence[Mapping[str, Look]], height: float = 6.5, columns: int = 1, **keywords: Any
) -> tuple[Figure, NDArray[Any]]:
    """Return a figure with a row of axes for each group: (groups, columns) of them.

    Parameters
    ----------
    shown : sequence of mapping
        From `looks`.
    height : float
        Of a figure of one group [inches].
    columns : int
        Of axes.
    **keywords
        For `new_figure`.
    """
    rows = len(shown)
    tall = height if rows == 1 else 1.0 + 0.68 * height * rows
    return new_figure(tall, rows, columns, squeeze=False, **keywords)


def legend_beside(axes: Any, extra: Sequence[Any] = (), others: bool = False, **keywords: Any) -> None:
    """Put a legend to the right of its axes, with `extra` entries below, and what stands behind in grey."""
    _legend(axes, extra, others, loc="upper left", bbox_to_anchor=(1.01, 1.0), **keywords)


def legend_above(axes: Any, extra: Sequence[Any] = (), others: bool = False, **keywords: Any) -> None:
    """Put the same legend above its axes, where several stand side by side."""
    _legend(axes, extra, others, loc="lower left", bbox_to_anchor=(0.0, 1.02), **keywords)


def _legend(axes: Any, extra: Sequence[Any], others: bool, **keywords: Any) -> None:
    with rc_context(_FONT):
        handles = [*axes.get_legend_handles_labels()[0], *extra]
        if others:
            handles.append(Line2D([], [], color=OTHERS, linewidth=1.5, label="the others"))
        axes.legend(handles=handles, borderaxespad=0, frameon=False, **keywords)


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
