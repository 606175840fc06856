"""A prior estimate as a measurement: drawn around the truth once per trial, before the run."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import Context

from quietfix.systems.linear_algebra import semidefinite_root
from quietfix.systems.noise import normal
from quietfix.systems.signals import EnsembleBlock

__all__ = ["PriorEstimate"]

Array = NDArray[np.float64]


class PriorEstimate(EnsembleBlock):
    r"""Input ``target``, output ``initial_estimate``: the target's state plus a draw of N(0, covariance) per trial.

    The draw is the same at all times; an estimator reads the port when it starts.

    .. math:: x_0 = x(t_0) + e, \qquad e \sim N(0, P)

    Parameters
    ----------
    covariance : array_like, shape (n, n)
        Of the prior; may be singular.
    trials, target_trials : int
        Trials of the output and of the input.
    name : str
        Name of the block; part of the key of its random numbers.
    """

    def __init__(self, covariance: ArrayLike, trials: int, target_trials: int = 1, name: str = "prior") -> None:
        super().__init__(name)
        self._root = semidefinite_root(covariance)
        self._trials, n = trials, self._root.shape[-1]
        self.declare_input("target", target_trials, n)
        draw = self.declare_draw()
        self.declare_output("initial_estimate", trials, n, self._calc, {self.input_ticket("target"), draw})

    def _calc(self, context: Context) -> Array:
        draw, n = self.draw(context), self._root.shape[-1]
        white = normal(draw.seed, self.noise_name(), draw.first_trial, self._trials, 0, n)
        return self.read(context, "target") + np.einsum("ij,...j->...i", self._root, white)
