"""Motions of independent parts of a state, side by side."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.motion.base import MotionModel

__all__ = ["SideBySide"]

Array = NDArray[np.float64]


class SideBySide(MotionModel):
    r"""A state of several parts that move independently of each other, such as a target and its oscillator's bias.

    .. math:: \Phi = \operatorname{diag}(\Phi_1, \Phi_2, \ldots), \qquad Q = \operatorname{diag}(Q_1, Q_2, \ldots)

    Parameters
    ----------
    parts : sequence of MotionModel
        In the order of the state; none with an input, no component's name twice.
    """

    def __init__(self, parts: Sequence[MotionModel]) -> None:
        self.parts = list(parts)
        self.names = tuple(name for part in self.parts for name in part.names)
        self.units = tuple(unit for part in self.parts for unit in part.units)
        if not self.parts or len(set(self.names)) < len(self.names):
            raise ValueError(f"motions side by side: {list(self.names)} is not allowed; different names")
        if any(part.input_size for part in self.parts):
            raise ValueError("motions side by side: a motion with an input is not allowed")
        self.linear = all(part.linear for part in self.parts)
        self.nominal = {name: value for part in self.parts for name, value in part.nominal.items()}
        self._slices = [slice(a, b) for a, b in pairwise(accumulate((p.size for p in self.parts), initial=0))]

    def propagate(self, state: Array, dt: float) -> Array:
        """See `MotionModel.propagate`."""
        moved = [part.propagate(state[..., own], dt) for own, part in zip(self._slices, self.parts, strict=True)]
        return np.concatenate(moved, axis=-1)

    def transition(self, state: Array, dt: float) -> Array:
        """See `MotionModel.transition`."""
        return self._diagonal([p.transition(state[..., own], dt) for own, p in self._pairs()])

    def process_noise(self, state: Array, dt: float) -> Array:
        """See `MotionModel.process_noise`."""
        return self._diagonal([p.process_noise(state[..., own], dt) for own, p in self._pairs()])

    def _pairs(self) -> list[tuple[slice, MotionModel]]:
        return list(zip(self._slices, self.parts, strict=True))

    def _diagonal(self, blocks: Sequence[Array]) -> Array:
        leading = np.broadcast_shapes(*(block.shape[:-2] for block in blocks))
        whole = np.zeros((*leading, self.size, self.size))
        for own, block in zip(self._slices, blocks, strict=True):
            whole[..., own, own] = block
        return whole
