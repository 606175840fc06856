"""What a motion model is."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import Step

__all__ = ["MotionModel"]

Array = NDArray[np.float64]


class MotionModel(ABC):
    """A discrete-time motion model; all methods work over leading axes.

    Attributes
    ----------
    names, units : tuple of str
        Names and SI units of the state's components.
    linear : bool
        True where `propagate` is ``transition @ state`` (plus the effect of an input that is held) and the transition
        does not depend on the state; an unscented filter then predicts in closed form.
    input_size : int
        How many numbers per trial an estimator has to carry from step to step as an input of the motion (a mean
        acceleration, say); with 0 the three methods for it are never called.
    considered : tuple of int
        Components whose uncertainty counts and which are not estimated: a filter keeps their mean and variance.
    nominal : mapping of str to float
        What a component is worth in a truth that has no such component, for the bounds: 0 unless it is named here
        (a scale factor, say, is 1).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    linear: bool = False
    input_size: int = 0
    considered: tuple[int, ...] = ()
    nominal: Mapping[str, float] = MappingProxyType({})

    @property
    def size(self) -> int:
        """Number of state components."""
        return len(self.names)

    @property
    def reported(self) -> MotionModel:
        """The motion of what an estimator reports, the first components: all of them, unless biases stand behind."""
        return self

    @abstractmethod
    def propagate(self, state: Array, dt: float) -> Array:
        """Return the state `dt` seconds later; shapes (..., n) -> (..., n)."""

    @abstractmethod
    def transition(self, state: Array, dt: float) -> Array:
        """Return the derivative of `propagate` with respect to the state, shape (..., n, n) or (n, n)."""

    @abstractmethod
    def process_noise(self, state: Array, dt: float) -> Array:
        """Return the covariance of the process noise over `dt`, shape (..., n, n) or (n, n)."""

    def equations(self, dt: float) -> Step | None:
        """Return the compiled equations of a step of `dt` seconds, where the model has them; see `held` for its input.

        They must be those of `propagate`, `transition` and `process_noise`.
        """
        return None

    @property
    def held(self) -> Array | None:
        """The input that a `driven` model holds, shape (..., input_size)."""
        return None

    def initial_input(self, state: Array) -> Array:
        """Return the input to begin with, shape (..., input_size)."""
        raise NotImplementedError

    def next_input(self, state: Array, previous: Array, dt: float) -> Array:
        """Return the input of the step of `dt` seconds that begins at `state`, shape (..., input_size)."""
        raise NotImplementedError

    def driven(self, value: Array) -> MotionModel:
        """Return the model with its input held at `value`, shape (..., input_size)."""
        raise NotImplementedError
