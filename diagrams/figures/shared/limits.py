"""Where axes end when a few numbers lie far off; what is outside is counted, and marked at the edge."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Span", "curve_span", "mark_beyond", "reach"]

Array = NDArray[np.float64]

_EDGE, _MOST_OF_THEM = 3.0, 90  # the axes end at so many times what so many percent of the dots keep
_WIDER = 20.0  # a cloud that is so many times wider than half of them does not set the axes
_DECADE = 10.0  # a logarithmic axis ends so many times beyond what a curve keeps at 9 of 10 epochs
_APART = 1000.0  # a curve that is so many times further off than half of them does not set the axis


def reach(clouds: ArrayLike) -> tuple[float | None, int]:
    """Return where an axis may end so that a few dots far off do not press the others into one point.

    A cloud twenty times wider than half of them does not set the axis either.

    Parameters
    ----------
    clouds : array_like, shape (n, 2) or (k, n, 2)
        Dots around the origin; of k clouds; those that are not finite take no part.

    Returns
    -------
    edge : float or None
        Half the width of the axes; None where all dots belong together.
    beyond : int
        How many dots lie outside.
    """
    far = np.abs(np.asarray(clouds, dtype=float)).max(axis=-1, initial=0.0)
    far = np.where(np.isfinite(far), far, np.nan).reshape(-1, far.shape[-1])
    far = far[np.isfinite(far).any(axis=-1)]
    if not far.size:
        return None, 0
    wide = np.nanpercentile(far, _MOST_OF_THEM, axis=-1)
    middle = np.sort(wide)[(wide.size - 1) // 2]
    edge = _EDGE * float(wide[wide <= _WIDER * middle].max())
    if not 0 < _EDGE * edge < np.nanmax(far):
        return None, 0
    return edge, int(np.count_nonzero(far > edge))


class Span:
    """The two ends of a logarithmic axis; None where the numbers themselves set it.

    Parameters
    ----------
    low, high : float or None
    """

    def __init__(self, low: float | None = None, high: float | None = None) -> None:
        self.low, self.high = low, high

    def above(self, values: Array) -> NDArray[np.bool_]:
        """Return which numbers are above the axis, the infinite ones too."""
        return np.asarray(values > (np.inf if self.high is None else self.high)) | np.isposinf(values)

    def below(self, values: Array) -> NDArray[np.bool_]:
        """Return which numbers are below the axis, zero too."""
        with np.errstate(invalid="ignore"):
            return np.asarray(values < (0.0 if self.low is None else self.low)) | (values == 0)

    def told(self, values: Array, unit: str = "epoch") -> list[str]:
        """Return what a legend must say of a curve, a number for each `unit`, of which not all is drawn."""
        infinite = np.isposinf(values)
        above, below = self.above(values) & ~infinite, self.below(values)
        counts = [f"{part.sum()} {unit}{'' if part.sum() == 1 else 's'}" for part in (infinite, above, below)]
        found = [f"infinite at {counts[0]}"] if infinite.any() else []
        if above.any():
            found.append(f"above at {counts[1]}, up to {values[above].max():.2g}")
        if below.any():
            found.append(f"below at {counts[2]}")
        return found

    def limit(self, axes: Any) -> None:
        """Set the ends that there are."""
        if self.low is not None:
            axes.set_ylim(bottom=self.low)
        if self.high is not None:
            axes.set_ylim(top=self.high)


def curve_span(curves: Sequence[ArrayLike], below: Sequence[ArrayLike] = ()) -> Span:
    """Return where a logarithmic axis may end so that some curves can be told apart.

    What happens at one of ten epochs, and a curve a thousand times further off than half of them, does not set the
    upper end; what happens at one of ten epochs does not set the lower one.

    Parameters
    ----------
    curves : sequence of array_like
        Numbers; those that are not finite or not positive take no part.
    below : sequence of array_like
        Others, which may set the lower end but not the upper one.
    """
    known = [kept for kept in map(_positive, curves) if kept.size]
    if not known:
        return Span()
    high = np.array([np.percentile(values, _MOST_OF_THEM) for values in known])
    middle = np.sort(high)[(high.size - 1) // 2]
    top = _DECADE * float(high[high <= _APART * middle].max())
    lower = known + [kept for kept in map(_positive, below) if kept.size]
    bottom = min(float(np.percentile(values, 100 - _MOST_OF_THEM)) for values in lower) / _DECADE
    largest, smallest = max(values.max() for values in known), min(values.min() for values in lower)
    return Span(
        bottom if smallest < bottom / _DECADE else None,
        top if largest > _DECADE * top else None,
    )


def _positive(values: ArrayLike) -> Array:
    numbers = np.asarray(values, dtype=float)
    return numbers[np.isfinite(numbers) & (numbers > 0)]


def mark_beyond(axes: Any, at: ArrayLike, values: ArrayLike, span: Span, color: str) -> None:
    """Mark at the edges of axes where a curve is beyond them: a line along the edge, and where that begins an arrow.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
    at, values : array_like, shape (n,)
        The curve.
    span : Span
        Of the axes.
    color : str
        Of the curve.
    """
    place, numbers = np.asarray(at, dtype=float), np.asarray(values, dtype=float)
    for beyond, height, marker in ((span.above(numbers), 1.0, "^"), (span.below(numbers), 0.0, "v")):
        stretches = np.flatnonzero(beyond & ~np.concatenate([[False], beyond[:-1]]))
        if stretches.size:
            edge = np.where(beyond, height, np.nan)
            keywords: Any = {"color": color, "transform": axes.get_xaxis_transform(), "clip_on": False}
            axes.plot(place, edge, linewidth=3, solid_capstyle="butt", zorder=5, label="_beyond", **keywords)
            axes.plot(
                place[stretches],
                np.full(stretches.size, height),
                marker,
                markersize=7,
                markeredgecolor="white",
                markeredgewidth=0.6,
                zorder=6,
                label="_beyond",
                **keywords,
            )
