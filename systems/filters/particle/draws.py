"""The random numbers of a particle filter at one instant."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.noise import generators, many_normal, uniform

__all__ = ["Draws"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Draws:
    """Pure functions of (seed, block, instant, purpose, trial), whichever trials are asked for.

    Parameters
    ----------
    seed : int
        Seed of the study.
    name : str
        Name of the block.
    sample : int
        Which instant.
    trials : ndarray of int
        Numbers of the trials; `which` below says which of these.
    """

    seed: int
    name: str
    sample: int
    trials: NDArray[np.intp]

    def of(self, which: NDArray[np.intp]) -> Draws:
        """Return the draws of some of the trials."""
        return replace(self, trials=self.trials[which])

    def normal(self, purpose: str, which: NDArray[np.intp], shape: tuple[int, ...]) -> Array:
        """Return standard normal numbers, shape (len(which), *shape)."""
        return many_normal(self.seed, f"{self.name}:{purpose}", self.trials[which], self.sample, shape)

    def generators(self, purpose: str, which: NDArray[np.intp]) -> NDArray[np.uint64]:
        """Return the states (len(which), 4) of the generators from which `normal` draws."""
        return generators(self.seed, f"{self.name}:{purpose}", self.trials[which], self.sample)

    def uniform(self, purpose: str, which: NDArray[np.intp], size: int) -> Array:
        """Return numbers in (0, 1), shape (len(which), size)."""
        numbers = self.trials[which]
        if numbers.size == 0:
            return np.empty((0, size))
        first, last = int(numbers.min()), int(numbers.max())
        drawn = uniform(self.seed, f"{self.name}:{purpose}", first, last - first + 1, self.sample, size)
        return drawn[numbers - first]
