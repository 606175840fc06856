"""Arrays as JSON that is small: as many digits as an eye can see, and long series thinned."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["packed", "reach", "rounded", "thinned"]

_DIGITS = 6
_EDGE, _MOST_OF_THEM = 3.0, 90  # axes end at so many times what so many percent of the dots keep


def rounded(values: ArrayLike) -> Any:
    """Return numbers of any shape as lists, of six significant digits; None where one is not finite."""
    array = np.asarray(values, dtype=float)
    if array.ndim == 0:
        return float(f"{float(array):.{_DIGITS}g}") if np.isfinite(array) else None
    return [rounded(value) for value in array]


def packed(values: ArrayLike) -> str:
    """Return numbers, row by row, as base64 of little-endian single precision; NaN stays NaN."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")


def thinned(count: int, most: int) -> NDArray[np.intp]:
    """Return places of at most `most` of `count` entries, evenly, the first and the last among them."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.intp))


def reach(dots: ArrayLike) -> tuple[float | None, int]:
    """Return where an axis may end so that a few dots far off do not press the others into one point.

    Parameters
    ----------
    dots : array_like, shape (n, 2)
        Around the origin.

    Returns
    -------
    edge : float or None
        Half the width of the axes; None where all dots belong together.
    beyond : int
        How many dots lie outside.
    """
    far = np.abs(np.asarray(dots, dtype=float)).max(axis=-1, initial=0.0)
    far = far[np.isfinite(far)]
    edge = _EDGE * float(np.percentile(far, _MOST_OF_THEM)) if far.size else 0.0
    if not 0 < _EDGE * edge < far.max(initial=0.0):
        return None, 0
    return edge, int(np.count_nonzero(far > edge))
