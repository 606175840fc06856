"""What a motion model is."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import NDArray

__all__ = ["MotionModel"]

Array = NDArray[np.float64]


class MotionModel(ABC):
    """A discrete-time motion model; all methods work over leading axes.

    Attributes
    ----------
    names, units : tuple of str
        Names and SI units of the state's components.
    linear : bool
        True where `propagate` is ``transition @ state`` and the transition does not depend on the state;
        an unscented filter then predicts in closed form.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    linear: bool = False

    @property
    def size(self) -> int:
        """Number of state components."""
        return len(self.names)

    @abstractmethod
    def propagate(self, state: Array, dt: float) -> Array:
        """Return the state `dt` seconds later; shapes (..., n) -> (..., n)."""

    @abstractmethod
    def transition(self, state: Array, dt: float) -> Array:
        """Return the derivative of `propagate` with respect to the state, shape (..., n, n) or (n, n)."""

    @abstractmethod
    def process_noise(self, state: Array, dt: float) -> Array:
        """Return the covariance of the process noise over `dt`, shape (..., n, n) or (n, n)."""
