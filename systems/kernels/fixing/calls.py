"""Iterations of fixes, called with arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.loading import ready
from quietfix.systems.kernels.sharing import Parts, call
from quietfix.systems.kernels.updating import plain

__all__ = ["known_height"]

Array = NDArray[np.float64]

_KNOWN_HEIGHT = Parts((0, 1, 2, 6), -1, each=0.7)


def known_height(
    ranges: Array, satellites: Array, height: Array, start: Array, rule: tuple[int, float, float]
) -> Array:
    """Return positions (trials, 3) from which all satellites are above the horizon; NaN where there is none.

    Of range differences (trials, 2) [m] and heights (trials,) [m]; `satellites` is (1 or trials, 3, 3), `start`
    (trials, 3); `rule`: steps at most, the longest, and the last [m].
    """
    position = np.array(start, dtype=float)
    arguments = plain(ranges), plain(satellites), plain(height), *rule, position
    call(ready("fixing.known_height:newton"), arguments, len(position), _KNOWN_HEIGHT)
    return position
