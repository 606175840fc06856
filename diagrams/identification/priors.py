"""What is believed of an oscillator and of elements before anything is heard."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["ORDERS", "Priors"]

Array = NDArray[np.float64]

ORDERS = {"bias": 1, "drift": 2, "rate": 3}
"""States of the oscillator by its last one."""


@dataclass(frozen=True)
class Priors:
    """What is believed before.

    Attributes
    ----------
    bias, drift, rate : float
        Standard deviations of the oscillator's error as range rate [m/s], [m/s^2], [m/s^3].
    time : float, optional
        That of the time that an object is ahead of its elements [s]; None: by their age.
    order : int
        How many states the oscillator has, at most five.
    """

    bias: float = 30_000.0
    drift: float = 3.0
    rate: float = 0.01
    time: float | None = None
    order: int = 2

    @property
    def oscillator(self) -> Array:
        """Standard deviations of one pass's states, shape (order,)."""
        further = [self.rate / 100.0, self.rate / 1e4]
        return np.array([self.bias, self.drift, self.rate, *further])[: self.order]
