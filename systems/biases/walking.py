"""The motion of a target, and of biases that walk beside it."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.biases.bias import Bias
from quietfix.systems.kernels.equations import Step, are_own, step
from quietfix.systems.motion.base import MotionModel

__all__ = ["WithBiases"]

Array = NDArray[np.float64]


@lru_cache(maxsize=64)
def _step(inner: Step, n: int, gained: tuple[float, ...]) -> Step:
    """Return the compiled step of a motion of n states with biases behind, whose variances grow by so much."""
    kernels, parameters = [], []
    for k, (address, _, _, begin, end) in enumerate(inner.parts.tolist()):
        own = inner.parameters[begin:end].tolist()
        kernels.append("biases:walking_noise" if k else "biases:walking")
        parameters.append([address, n, *((len(gained), *gained) if k else ()), *own])
    return step(kernels, parameters, _beside(inner.noise[0], gained))


def _beside(matrix: Array, diagonal: Sequence[float]) -> Array:
    """Return matrices (..., n, n) with a diagonal behind."""
    n, k = matrix.shape[-1], len(diagonal)
    whole = np.zeros((*matrix.shape[:-2], n + k, n + k))
    whole[..., :n, :n] = matrix
    whole[..., np.arange(n, n + k), np.arange(n, n + k)] = diagonal
    return whole


class WithBiases(MotionModel):
    r"""A target that moves as another model says, and biases that walk at random, independent of it and of each other.

    .. math:: \Phi = \operatorname{diag}(\Phi_x, I), \qquad Q = \operatorname{diag}(Q_x, w^2\,dt)

    Parameters
    ----------
    motion : MotionModel
        Of the target.
    biases : sequence of Bias
        In the order of the state behind it; no name twice.
    """

    def __init__(self, motion: MotionModel, biases: Sequence[Bias]) -> None:
        self.motion = motion
        self.biases = tuple(biases)
        self.names = (*motion.names, *(bias.name for bias in biases))
        self.units = (*motion.units, *(bias.unit for bias in biases))
        if not biases or len(set(self.names)) < len(self.names):
            raise ValueError(f"biases: {list(self.names)} is not allowed; at least one, and no name twice")
        self.linear, self.input_size = motion.linear, motion.input_size
        self.nominal = {**motion.nominal, **{bias.name: bias.true for bias in biases}}
        self.considered = tuple(motion.size + i for i, bias in enumerate(biases) if bias.considered)
        self._walks = np.square([bias.walk for bias in biases])

    @property
    def reported(self) -> MotionModel:
        """See `MotionModel.reported`: the target's."""
        return self.motion

    def _split(self, state: Array) -> tuple[Array, Array]:
        return state[..., : self.motion.size], state[..., self.motion.size :]

    def propagate(self, state: Array, dt: float) -> Array:
        """See `MotionModel.propagate`."""
        own, biases = self._split(state)
        moved = self.motion.propagate(own, dt)
        return np.concatenate([moved, np.broadcast_to(biases, (*moved.shape[:-1], biases.shape[-1]))], axis=-1)

    def transition(self, state: Array, dt: float) -> Array:
        """See `MotionModel.transition`."""
        return _beside(self.motion.transition(self._split(state)[0], dt), [1.0] * len(self.biases))

    def process_noise(self, state: Array, dt: float) -> Array:
        """See `MotionModel.process_noise`."""
        return _beside(self.motion.process_noise(self._split(state)[0], dt), self._gained(dt))

    def _gained(self, dt: float) -> tuple[float, ...]:
        return tuple((abs(dt) * self._walks).tolist())

    def equations(self, dt: float) -> Step | None:
        """See `MotionModel.equations`; those of the target's motion, where it has them."""
        inner = self.motion.equations(dt) if are_own(type(self.motion)) else None
        return None if inner is None else _step(inner, self.motion.size, self._gained(dt))

    # ---- the input is the target's

    @property
    def held(self) -> Array | None:
        """See `MotionModel.held`."""
        return self.motion.held

    def initial_input(self, state: Array) -> Array:
        """See `MotionModel.initial_input`."""
        return self.motion.initial_input(self._split(state)[0])

    def next_input(self, state: Array, previous: Array, dt: float) -> Array:
        """See `MotionModel.next_input`."""
        return self.motion.next_input(self._split(state)[0], previous, dt)

    def driven(self, value: Array) -> WithBiases:
        """See `MotionModel.driven`."""
        found = copy(self)
        found.motion = self.motion.driven(value)
        return found
