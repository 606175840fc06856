"""What a medium adds to the path of a ray that leaves it, and its derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

__all__ = ["EARTH_RADIUS", "Column", "Medium"]

Array = NDArray[np.float64]

EARTH_RADIUS = 6371e3
"""Mean radius of the Earth, that of a medium's layers [m]."""


@dataclass(frozen=True)
class Column:
    """Excess path [m] of a ray from a height h on outwards, and its partial derivatives; u is the elevation's sine.

    Attributes
    ----------
    value, by_h, by_u, by_hh, by_hu, by_uu : ndarray, all of one shape
    """

    value: Array
    by_h: Array
    by_u: Array
    by_hh: Array
    by_hu: Array
    by_uu: Array

    def __add__(self, other: Column) -> Column:
        """Return that of two media in the same place."""
        return Column(
            self.value + other.value,
            self.by_h + other.by_h,
            self.by_u + other.by_u,
            self.by_hh + other.by_hh,
            self.by_hu + other.by_hu,
            self.by_uu + other.by_uu,
        )


class Medium(Protocol):
    """Something that signals pass.

    Attributes
    ----------
    phase_sign : float
        What it adds to the path of a carrier's phase, over what it adds to that of a group; -1: it advances phases.
    bottom : float
        Between two places below this height it adds nothing [m].
    """

    @property
    def phase_sign(self) -> float:
        """See above."""

    @property
    def bottom(self) -> float:
        """See above."""

    def column(self, height: Array, sine: Array) -> Column:
        """Return what it adds from a height [m] outwards, in a direction with this sine of the elevation."""
