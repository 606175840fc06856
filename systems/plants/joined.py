"""Several signals side by side on one port."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.signals import EnsembleBlock

__all__ = ["Joined"]

Array = NDArray[np.float64]


class Joined(EnsembleBlock):
    """Input ports as named; output ``state``: their columns in that order.

    Parameters
    ----------
    shapes : mapping of str to (trials, size)
        Name and shape of each input; those with one trial are shared by all trials.
    name : str
        Name of the block.
    """

    def __init__(self, shapes: Mapping[str, tuple[int, int]], name: str = "truth") -> None:
        super().__init__(name)
        trials = max(count for count, _ in shapes.values())
        if any(count not in (1, trials) for count, _ in shapes.values()):
            raise ValueError(f"{name}: trials {[count for count, _ in shapes.values()]} do not fit together")
        self._names, self._trials = list(shapes), trials
        for port, (count, size) in shapes.items():
            self.declare_input(port, count, size)
        tickets = {self.input_ticket(port) for port in shapes}
        self.declare_output("state", trials, sum(size for _, size in shapes.values()), self._join, tickets)

    def _join(self, context: Context) -> Array:
        parts = [self.read(context, port) for port in self._names]
        return np.concatenate([np.broadcast_to(p, (self._trials, p.shape[1])) for p in parts], axis=1)
