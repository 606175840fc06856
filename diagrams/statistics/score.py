"""A block that holds an estimate against the truth, so that studies need not keep every covariance."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.diagrams.quantities.states import columns, shared
from quietfix.systems.kernels.scoring.calls import normalised
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
    k = error.shape[-1]
    leading = np.broadcast_shapes(error.shape[:-1], covariance.shape[:-2])
    errors = np.broadcast_to(error, (*leading, k)).reshape(-1, k)
    return _normalised(errors, np.broadcast_to(covariance, (*leading, k, k)).reshape(-1, k, k), np.arange(k)).reshape(
        leading
    )


def _normalised(error: Array, covariance: Array, places: NDArray[np.int64]) -> Array:
    """Return it for errors (trials, k) of the `places` (k,) of covariances (trials, n, n)."""
    nees = normalised(error, covariance, places)
    left = np.isinf(nees)
    if left.any():
        nees[left] = _indefinite(error[left], covariance[left][:, places[:, None], places])
    return nees


def _indefinite(error: Array, covariance: Array) -> Array:
    """Return it for finite matrices that have no Cholesky factor: NaN where one is singular."""
    scale = np.sqrt(np.einsum("...ii->...i", covariance))
    correlation = covariance / (scale[..., :, None] * scale[..., None, :])
    scaled = error / scale
    full = np.ones(len(error), dtype=bool)
    try:
        solved = np.linalg.solve(correlation, scaled[..., None])[..., 0]
    except np.linalg.LinAlgError:  # one matrix is singular: LAPACK then refuses all of them
        full = np.linalg.matrix_rank(correlation, hermitian=True) == error.shape[-1]
        solved = np.linalg.solve(
            np.where(full[..., None, None], correlation, np.eye(error.shape[-1])), scaled[..., None]
        )[..., 0]
    return np.where(full, np.einsum("...i,...i->...", scaled, solved), np.nan)


class Score(EnsembleBlock):
    r"""Inputs ``truth``, ``estimate``, ``covariance``; output ``nees`` (trials, 1).

    .. math:: \epsilon = (\hat x - x)^T P^{-1} (\hat x - x)

    Chi-square with as many degrees of freedom as components are scored, where the estimator is right (Bar-Shalom, Li
    and Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 5.4).

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
        self._places = np.arange(self._size)[self._here]
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
        return _normalised(error, covariance, self._places)[:, None]
