"""States by the names of their components: which two of them share, and one written as the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.motion.base import MotionModel

__all__ = ["POSITION", "VELOCITY", "CarriedMotion", "Moves", "block", "columns", "shared", "translated"]

Array = NDArray[np.float64]

POSITION = ("x", "y", "z")
VELOCITY = ("vx", "vy", "vz")


def shared(first: Sequence[str], second: Sequence[str]) -> tuple[str, ...]:
    """Return the components that both states have, in the order of the first."""
    return tuple(name for name in first if name in second)


def columns(names: Sequence[str], wanted: Sequence[str]) -> slice | list[int]:
    """Return where the `wanted` components are in a state of `names`; a slice where they stand side by side."""
    found = [list(names).index(name) for name in wanted]
    if found and found == list(range(found[0], found[0] + len(found))):
        return slice(found[0], found[-1] + 1)
    return found


def block(matrices: Array, places: slice | list[int]) -> Array:
    """Return the rows and columns at `places` of matrices (..., n, n)."""
    if isinstance(places, slice):
        return matrices[..., places, places]
    return np.ascontiguousarray(matrices[..., np.array(places)[:, None], places])


def translated(state: Array, names: Sequence[str], motion: MotionModel) -> Array:
    """Return a state (..., n) of components `names` as one of a motion model, shape (..., motion.size).

    What it lacks has the model's `nominal` value: where the truth has no bias, the bias is zero.
    """
    if tuple(names) == tuple(motion.names):
        return state
    found = np.empty((*state.shape[:-1], motion.size))
    for i, name in enumerate(motion.names):
        found[..., i] = state[..., list(names).index(name)] if name in names else motion.nominal.get(name, 0.0)
    return found


class Moves(Protocol):
    """What a bound asks of a motion model."""

    @property
    def size(self) -> int:
        """Number of state components."""

    def transition(self, state: Array, dt: float) -> Array:
        """See `MotionModel.transition`."""

    def process_noise(self, state: Array, dt: float) -> Array:
        """See `MotionModel.process_noise`."""


@dataclass(frozen=True)
class CarriedMotion:
    r"""A true motion in the state of a filter that has other components.

    With s the components that both have and e those that the filter has beside them,

    .. math:: \Phi = \begin{pmatrix} \Phi^{true}_{ss} & \Phi^{own}_{se} \\ \Phi^{own}_{es} & \Phi^{own}_{ee}
              \end{pmatrix}, \qquad Q = \begin{pmatrix} Q^{true}_{ss} & 0 \\ 0 & 0 \end{pmatrix}:

    what the truth lacks follows the filter's law without noise, for it does not wander; what the filter lacks counts as
    known.

    Attributes
    ----------
    true, own : MotionModel
        What was simulated, and what the filter believes.
    names : tuple of str
        Components of the states that it is asked at: those of the truth.
    """

    true: MotionModel
    own: MotionModel
    names: tuple[str, ...]

    @property
    def size(self) -> int:
        """Number of components of the filter's state."""
        return self.own.size

    def _places(self) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
        both = shared(self.own.names, self.true.names)
        here, there = ([list(names).index(name) for name in both] for names in (self.own.names, self.true.names))
        return np.array(here, dtype=int), np.array(there, dtype=int)

    def _with_true(self, matrix: Array, true: Array) -> Array:
        here, there = self._places()
        leading = np.broadcast_shapes(matrix.shape[:-2], true.shape[:-2])
        found = np.array(np.broadcast_to(matrix, (*leading, self.size, self.size)))
        found[..., here[:, None], here] = true[..., there[:, None], there]
        return found

    def transition(self, state: Array, dt: float) -> Array:
        """Return the transition matrix at a state of the truth, shape (..., size, size)."""
        own = self.own.transition(translated(state, self.names, self.own), dt)
        return self._with_true(own, self.true.transition(translated(state, self.names, self.true), dt))

    def process_noise(self, state: Array, dt: float) -> Array:
        """Return the covariance of the process noise at a state of the truth, shape (..., size, size)."""
        true = self.true.process_noise(translated(state, self.names, self.true), dt)
        return self._with_true(np.zeros((self.size, self.size)), true)
