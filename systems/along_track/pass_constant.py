"""Numbers that are constant during a pass and others in the next one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.motion.base import MotionModel

__all__ = ["PassConstant"]

Array = NDArray[np.float64]


class PassConstant(MotionModel):
    r"""A number that keeps still, with :math:`\Phi = 1` and :math:`Q = q\,dt`, and is another one after a pause.

    After a step longer than `pause` it is unknown again: mean zero, variance that of the start, as in `PassOscillator`.

    Parameters
    ----------
    name, unit : str
        Of the state's component.
    sigma : float
        Standard deviation at the start of a pass, > 0.
    pause : float
        [s], > 0.
    density : float
        Variance that it gains per second within a pass, >= 0.
    """

    # Linear, but what a pause does is no power of what a second does: the laws of a linear motion do not hold for it.
    linear = True

    def __init__(self, name: str, unit: str, sigma: float, pause: float, density: float = 0.0) -> None:
        if not (math.isfinite(sigma) and sigma > 0):
            raise ValueError(f"{name} sigma: {sigma} is not allowed; it must be > 0 {unit}")
        if not pause > 0:
            raise ValueError(f"{name} pause: {pause} is not allowed; it must be > 0 s")
        if not (math.isfinite(density) and density >= 0):
            raise ValueError(f"{name} density: {density} is not allowed; it must be >= 0")
        self.names, self.units = (name,), (unit,)
        self.sigma, self.pause, self.density = float(sigma), float(pause), float(density)

    def propagate(self, state: Array, dt: float) -> Array:
        """See `MotionModel.propagate`."""
        return np.zeros_like(state) if dt > self.pause else np.array(state)

    def transition(self, state: Array, dt: float) -> Array:
        """See `MotionModel.transition`; shape (1, 1)."""
        return np.zeros((1, 1)) if dt > self.pause else np.eye(1)

    def process_noise(self, state: Array, dt: float) -> Array:
        """See `MotionModel.process_noise`; shape (1, 1)."""
        return np.array([[self.sigma**2 if dt > self.pause else self.density * dt]])
