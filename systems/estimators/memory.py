"""What an estimator remembers, at which instant, and what an update reports."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.signals import Draw

__all__ = ["TO_COME", "Epoch", "Innovation", "Memory", "Remembered"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Memory = dict[str, Array]


class Epoch:
    """Which instant it is.

    Parameters
    ----------
    time : float
        [s].
    tick : int, callable or None
        Index of the tick, None between ticks; a callable is asked only when somebody wants to know.
    draw : Draw or callable
        The run's random numbers; likewise.
    """

    __slots__ = ("_draw", "_tick", "time")

    def __init__(
        self, time: float, tick: int | Callable[[], int | None] | None, draw: Draw | Callable[[], Draw]
    ) -> None:
        self.time = time
        self._tick = tick
        self._draw = draw

    @property
    def tick(self) -> int | None:
        """Index of the tick, None between ticks."""
        return self._tick() if callable(self._tick) else self._tick

    @property
    def draw(self) -> Draw:
        """The run's random numbers."""
        return self._draw() if callable(self._draw) else self._draw


class Innovation(NamedTuple):
    """What an update reports: innovation (trials, m), NIS (trials,) and its degrees of freedom (trials,)."""

    value: Array
    nis: Array
    nis_dof: Array


TO_COME = Innovation(np.empty(0), np.empty(0), np.empty(0))  # of a prior


class Remembered:
    """What a cache holds: memory, innovation, which trials have started; the moments when they are first asked for.

    ``current`` says that the measurement of now is in it.
    """

    __slots__ = ("_moments", "current", "innovation", "memory", "started")

    def __init__(self, memory: Memory, innovation: Innovation, started: Mask, current: bool) -> None:
        self.memory = memory
        self.innovation = innovation
        self.started = started
        self.current = current
        self._moments: tuple[Array, Array] | None = None

    def moments(self, summarise: Callable[[Memory], tuple[Array, Array]]) -> tuple[Array, Array]:
        """Return mean and covariance."""
        if self._moments is None:
            self._moments = summarise(self.memory)
        return self._moments
