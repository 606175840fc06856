"""The truth that another's block puts out, behind the boundary where it is checked."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.signals import EnsembleBlock

__all__ = ["CheckedTruth"]

Array = NDArray[np.float64]


class CheckedTruth(EnsembleBlock):
    """Input ``plant`` (trials, size), output ``state`` (trials, 6): its first six numbers, which must be finite.

    Parameters
    ----------
    what : str
        What the error calls the block that puts it out.
    trials, size : int
        Shape of the input.
    name : str
        Name of the block.
    """

    def __init__(self, what: str, trials: int, size: int, name: str = "target") -> None:
        super().__init__(name)
        self._what = what
        self.declare_input("plant", trials, size)
        components = [*((axis, "m") for axis in "xyz"), *((f"v{axis}", "m/s") for axis in "xyz")]
        self.declare_output("state", trials, 6, self._calc, {self.input_ticket("plant")}, components)

    def _calc(self, context: Context) -> Array:
        state = self.read(context, "plant")[:, :6]
        if not np.isfinite(state).all():
            raise ValueError(f"{self._what}: at {context.get_time():g} s it puts out a number that is not finite")
        return state
