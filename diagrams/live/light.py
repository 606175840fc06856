"""How long light takes between two receivers: no difference of arrival times is more."""

from __future__ import annotations

import numpy as np

from quietfix.diagrams.own.fed.handed import Handed
from quietfix.systems.constants import SPEED_OF_LIGHT

__all__ = ["LightTimes"]

_KEPT = 60.0  # s; between two looks distances change little
_SPARE = 1.01


class LightTimes:
    r"""The most that a difference of arrival times can be, as `beyond_light` has it.

    Parameters
    ----------
    handed : Handed
        What can be measured, and where the receivers are.
    """

    def __init__(self, handed: Handed) -> None:
        self._handed = handed
        self._known: dict[int, tuple[float, float]] = {}

    def most(self, row: int, time: float) -> float:
        """Return the most that a row of times can be at a time, with one per cent to spare, both in s."""
        looked, most = self._known.get(row, (-np.inf, 0.0))
        if not abs(time - looked) < _KEPT:
            one, platforms = self._handed.rows[row], self._handed.platforms
            places = self._handed.carriers(time).reshape(-1, 6)[:, :3]
            apart = places[platforms[one.receiver]] - places[platforms[one.reference]]
            most = _SPARE * float(np.linalg.norm(apart)) / SPEED_OF_LIGHT
            self._known[row] = time, most
        return most
