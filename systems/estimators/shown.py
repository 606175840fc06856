"""What an estimator shows of its state: the target's, and apart from it the biases that stand behind."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.motion.base import MotionModel
from quietfix.systems.signals import EnsembleBlock, components_of

__all__ = ["Shown"]

Array = NDArray[np.float64]
Moments = Callable[[Context], tuple[Array, Array]]
Moment = Callable[[Context, int], Array]


class Shown:
    """Which of the components of a state are the target's, and which are biases.

    Parameters
    ----------
    motion : MotionModel
        Of the whole state.

    Attributes
    ----------
    size : int
        Components of the target's state, which come first.
    states, biases : list of Component
        Names and units.
    """

    def __init__(self, motion: MotionModel) -> None:
        self.size = motion.reported.size
        self.states = components_of(motion.reported)
        self.biases = components_of(motion)[self.size :]

    def declare(self, block: EnsembleBlock, trials: int, moment: Moment, tickets: Any, names: tuple[str, str]) -> None:
        """Declare output ports of the target's mean (trials, size) and covariance (trials, size, size).

        `moment` returns the mean, 0, or the covariance, 1, of the whole state.
        """
        n, k, whole = self.size, self.size + len(self.biases), not self.biases

        def mean(context: Context) -> Array:
            found = moment(context, 0)
            return found if whole else found.reshape(trials, k)[:, :n]

        def covariance(context: Context) -> Array:
            found = moment(context, 1)
            return found if whole else found.reshape(trials, k, k)[:, :n, :n]

        block.declare_output(names[0], trials, n, mean, tickets, self.states)
        block.declare_output(names[1], trials, n * n, covariance, tickets)

    def declare_biases(self, block: EnsembleBlock, trials: int, moments: Moments, tickets: Any) -> None:
        """Declare ``biases`` and ``bias_sigmas``: means and standard deviations (trials, k), where there are any.

        And, for who needs all that the estimator knows, ``whole`` and ``whole_covariance``: target and biases together.
        """
        n, k = self.size, len(self.biases)

        def means(context: Context) -> Array:
            return moments(context)[0][:, n:]

        def sigmas(context: Context) -> Array:
            return np.sqrt(np.einsum("...ii->...i", moments(context)[1])[:, n:])

        if k:
            block.declare_output("biases", trials, k, means, tickets, self.biases)
            block.declare_output("bias_sigmas", trials, k, sigmas, tickets, self.biases)
            block.declare_output("whole", trials, n + k, lambda c: moments(c)[0], tickets, [*self.states, *self.biases])
            block.declare_output("whole_covariance", trials, (n + k) ** 2, lambda c: moments(c)[1], tickets)
