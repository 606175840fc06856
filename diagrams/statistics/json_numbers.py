"""Numbers as JSON has them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["json_numbers"]


def json_numbers(value: ArrayLike) -> Any:
    """Return a Python float, or (nested) lists of them; None for what JSON cannot say: NaN and the infinities."""
    array = np.asarray(value, dtype=float)
    if array.ndim == 0:
        return float(array) if np.isfinite(array) else None
    return [json_numbers(item) for item in array]
