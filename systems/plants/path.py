"""A platform on a known path."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.signals import EnsembleBlock

__all__ = ["Path"]

Array = NDArray[np.float64]


class Path(EnsembleBlock):
    """A platform whose state is a function of time, the same in all trials.

    Port ``state`` (1, size): position [m] and velocity [m/s], of one or of several, one after the other.

    Parameters
    ----------
    at : callable
        ``at(time) -> (size,)``.
    name : str
        Name of the block.
    size : int
        Six times the number of those that move.
    """

    def __init__(self, at: Callable[[float], Array], name: str = "observer", size: int = 6) -> None:
        super().__init__(name)
        self.at = at
        self.declare_output("state", 1, size, lambda context: self.at(context.get_time())[None], {self.time_ticket()})
