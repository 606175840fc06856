"""What a platform's navigation reports of its own position."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.signals import EnsembleBlock

__all__ = ["Navigation"]

Array = NDArray[np.float64]


class Navigation(EnsembleBlock):
    r"""A platform's state with an error of position: what estimators know of their platform.

    Inputs ``platforms`` (1, 6) and ``error`` (trials, axes); output ``platforms`` (trials, 6).

    .. math:: p' = p + e

    Parameters
    ----------
    trials : int
        Trials of the error.
    axes : int
        Its components: x and y, and z.
    name : str
        Name of the block.
    """

    def __init__(self, trials: int, axes: int = 2, name: str = "navigation") -> None:
        super().__init__(name)
        self._axes = axes
        self.declare_input("platforms", 1, 6)
        self.declare_input("error", trials, axes)
        tickets = {self.input_ticket("platforms"), self.input_ticket("error")}
        self.declare_output("platforms", trials, 6, self._report, tickets)

    def _report(self, context: Context) -> Array:
        error = self.read(context, "error")
        reported = np.repeat(self.read(context, "platforms"), error.shape[0], axis=0)
        reported[:, : self._axes] += error
        return reported
