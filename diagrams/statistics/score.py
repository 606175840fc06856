"""A block that holds an estimate against the truth, so that studies need not keep every covariance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.diagrams.quantities.states import block, columns, shared
from quietfix.systems.signals import EnsembleBlock

__all__ = ["Score", "normalised_error"]

Array = NDArray[np.float64]


def normalised_error(error: Array, covariance: Array) -> Array:
    r"""Return the normalised estimation error squared :math:`e^T P^{-1} e`, shape (...).

    Parameters
    ----------
    error : ndarray, shape (..., n)
    covariance : ndarray, shape (..., n, n)
        A trial in which it is not finite or singular gives NaN, and only that trial.
    """
    scale = np.sqrt(np.einsum("...ii->...i", covariance))
    good = np.isfinite(covariance).all(axis=(-1, -2)) & np.isfinite(error).all(axis=-1) & (scale > 0).all(axis=-1)
    safe = np.where(good[..., None], scale, 1.0)
    correlation = np.where(
        good[..., None, None], covariance / (safe[..., :, None] * safe[..., None, :]), np.eye(error.shape[-1])
    )
    scaled = np.where(good[..., None], error / safe, 0.0)
    try:
        solved = np.linalg.solve(correlation, scaled[..., None])[..., 0]
    except np.linalg.LinAlgError:  # one matrix is singular: LAPACK then refuses all of them
        full = np.linalg.matrix_rank(correlation, hermitian=True) == error.shape[-1]
        good = good & full
        solved = np.linalg.solve(
            np.where(full[..., None, None], correlation, np.eye(error.shape[-1])), scaled[..., None]
        )
        solved = solved[..., 0]
    nees = np.einsum("...i,...i->...", scaled, solved)
    return np.where(good, nees, np.nan)


class Score(EnsembleBlock):
    """Inputs ``truth``, ``estimate``, ``covariance``; output ``nees`` (trials, 1).

    Parameters
    ----------
    name : str
        Name of the block.
    trials, truth_trials : int
        Trials of the estimate and of the truth.
    truth_names, estimate_names : sequence of str
        Components of their states; those that both have are scored, with their block of the covariance.

    Attributes
    ----------
    scored : tuple of str
        The components that both have: as many degrees of freedom has the NEES, which is NaN if there are none.
    """

    def __init__(
        self, name: str, trials: int, truth_trials: int, truth_names: Sequence[str], estimate_names: Sequence[str]
    ) -> None:
        super().__init__(name)
        self.scored = shared(estimate_names, truth_names)
        self._here, self._there = columns(estimate_names, self.scored), columns(truth_names, self.scored)
        self._size = len(estimate_names)
        self.declare_input("truth", truth_trials, len(truth_names))
        self.declare_input("estimate", trials, self._size)
        self.declare_input("covariance", trials, self._size**2)
        tickets = {self.input_ticket(port) for port in ("truth", "estimate", "covariance")}
        self.declare_output("nees", trials, 1, self._calc, tickets)

    def _calc(self, context: Context) -> Array:
        estimate, n = self.read(context, "estimate"), self._size
        if not self.scored:
            return np.full((len(estimate), 1), np.nan)
        error = estimate[:, self._here] - self.read(context, "truth")[:, self._there]
        covariance = self.read(context, "covariance").reshape(-1, n, n)
        return normalised_error(error, block(covariance, self._here))[:, None]
