"""Prior knowledge of the target: a measurement made before the run."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import Context

from quietfix.systems.noise import uniform
from quietfix.systems.signals import EnsembleBlock

__all__ = ["OffsetPrior"]

Array = NDArray[np.float64]


class OffsetPrior(EnsembleBlock):
    r"""The truth plus a given error, from a given instant on; before it NaN.

    Input ``truth``; outputs ``initial_estimate_N`` (trials, N) for every number of states asked for.

    .. math:: x_0 = x(t_0) + \Delta

    Parameters
    ----------
    offset : array_like, shape (n,)
        Error of each state.
    known : array_like of bool, shape (n,)
        Where False the prior says 0 instead of the truth; its error is then 0 as well.
    sizes : sequence of int
        Numbers of states that the estimators have, each <= n.
    time : float
        When the prior is given [s].
    trials, truth_trials : int
        Trials of the prior and of the truth.
    random_signs : bool
        Draw the sign of each error per trial; else they are as given in every trial.
    name : str
        Name of the block.
    """

    def __init__(
        self,
        offset: ArrayLike,
        known: ArrayLike,
        sizes: Sequence[int],
        time: float,
        trials: int,
        truth_trials: int = 1,
        random_signs: bool = False,
        name: str = "prior",
    ) -> None:
        super().__init__(name)
        self._offset, self._known = np.array(offset, dtype=float), np.array(known, dtype=bool)
        if self._offset.ndim != 1 or self._known.shape != self._offset.shape:
            raise ValueError(f"{name}: offset {self._offset.shape} and known {self._known.shape} must be alike")
        n = self._offset.size
        wrong = [size for size in sizes if not 1 <= size <= n]
        if wrong or not np.all(np.isfinite(self._offset)):
            raise ValueError(f"{name}: sizes {list(sizes)} and finite offsets of {n} states are needed")
        self._time, self._random, self.trials = float(time), random_signs, trials
        self.declare_input("truth", truth_trials, n)
        draw = self.declare_draw()
        tickets = {self.time_ticket(), self.input_ticket("truth"), draw}
        for size in dict.fromkeys(sizes):
            self.declare_output(f"initial_estimate_{size}", trials, size, partial(self._first, size), tickets)

    def _first(self, size: int, context: Context) -> Array:
        return self._prior(context)[:, :size]

    def _prior(self, context: Context) -> Array:
        if context.get_time() < self._time:
            return np.full((self.trials, self._offset.size), np.nan)
        error = np.broadcast_to(self._offset, (self.trials, self._offset.size))
        if self._random:
            draw = self.draw(context)
            heads = uniform(draw.seed, self.noise_name(), draw.first_trial, self.trials, 0, self._offset.size) < 0.5
            error = np.where(heads, -error, error)
        return np.where(self._known, self.read(context, "truth") + error, 0.0)
