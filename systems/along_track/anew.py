"""A motion that begins anew in every pass: an oscillator that was switched on, a satellite with other elements."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.motion.base import MotionModel

__all__ = ["Anew"]

Array = NDArray[np.float64]


class Anew(MotionModel):
    r"""A linear motion within a pass; after a pause its states are unknown again, as at the start.

    After a step longer than `pause` they have mean zero and the variances `sigmas` squared: :math:`\Phi = 0`,
    :math:`Q = \operatorname{diag}(\sigma_k^2)`, as in `quietfix.systems.motion.pass_oscillator.PassOscillator`.

    Parameters
    ----------
    motion : MotionModel
        Within a pass; linear, without an input.
    sigmas : sequence of float
        Standard deviation of each state at the start of a pass, > 0.
    pause : float
        [s], > 0.
    """

    # Linear, but what a pause does is no power of what a second does: the laws of a linear motion do not hold for it.
    linear = True

    def __init__(self, motion: MotionModel, sigmas: Sequence[float], pause: float) -> None:
        if not motion.linear or motion.input_size:
            raise ValueError(f"anew: {type(motion).__name__} is not allowed; a linear motion without an input")
        if len(sigmas) != motion.size or any(not (math.isfinite(s) and s > 0) for s in sigmas):
            raise ValueError(f"anew: sigmas {list(sigmas)} are not allowed; {motion.size} numbers > 0")
        if not pause > 0:
            raise ValueError(f"anew: pause {pause} is not allowed; it must be > 0 s")
        self.motion, self.names, self.units = motion, motion.names, motion.units
        self.nominal = motion.nominal
        self.sigmas, self.pause = tuple(float(s) for s in sigmas), float(pause)

    def propagate(self, state: Array, dt: float) -> Array:
        """See `MotionModel.propagate`."""
        return np.zeros_like(state) if dt > self.pause else self.motion.propagate(state, dt)

    def transition(self, state: Array, dt: float) -> Array:
        """See `MotionModel.transition`."""
        return np.zeros((self.size, self.size)) if dt > self.pause else self.motion.transition(state, dt)

    def process_noise(self, state: Array, dt: float) -> Array:
        """See `MotionModel.process_noise`."""
        return np.diag(np.square(self.sigmas)) if dt > self.pause else self.motion.process_noise(state, dt)
