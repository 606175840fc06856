"""Arrays as JSON that is small: as many digits as an eye can see, and long series thinned."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["packed", "rounded", "thinned"]

_DIGITS = 6


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
