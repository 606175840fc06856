"""A bank of hypotheses, each with a Gaussian belief and a weight: evidence, weighing, moments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.linear_algebra import cholesky, symmetric

__all__ = ["branch", "in_doubt", "log_evidence", "mixture", "normalised", "reweigh"]

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

_DOUBT = 3.5  # sigmas of the predicted phase; 5e-4 of the cases lie outside
_CYCLES = 2  # an integer this far from the nearest is still considered


def log_evidence(prior: tuple[Array, Array], posterior: tuple[Array, Array], whitened: Array) -> Array:
    r"""Return the log-likelihood of a measurement under a Gaussian prior, up to a constant of the noise alone.

    .. math:: \ln p(z) \approx -\tfrac12 (\hat x - x^0)^T P_0^{-1} (\hat x - x^0)
              - \tfrac12\,r^T R^{-1} r + \tfrac12 \ln\frac{|P|}{|P_0|}, \qquad r = z - h(\hat x)

    Laplace's method about the posterior mean. With a linear measurement it is
    :math:`-\tfrac12(\nu^T S^{-1} \nu + \ln|S| - \ln|R|)`; where the prior is wide against the curvature of the
    measurement, the innovation's own density is not to be trusted and this is.

    Parameters
    ----------
    prior, posterior : (ndarray, ndarray), shapes (..., n) and (..., n, n)
        Mean and covariance before and after.
    whitened : ndarray, shape (..., m)
        W r with :math:`W R W^T = I`; 0 in missing rows.

    Returns
    -------
    ndarray, shape (...)
    """
    before, after = cholesky(prior[1]), cholesky(posterior[1])
    moved = np.linalg.solve(before, (posterior[0] - prior[0])[..., None])[..., 0]
    narrowed = np.log(np.diagonal(after, axis1=-2, axis2=-1) / np.diagonal(before, axis1=-2, axis2=-1)).sum(axis=-1)
    distance = np.einsum("...i,...i->...", moved, moved) + np.einsum("...i,...i->...", whitened, whitened)
    return narrowed - 0.5 * distance


def in_doubt(turns: Array, sigma: Array) -> Mask:
    """Return which hypotheses allow more than one set of integers; arguments as in `branch`."""
    _, short, reach = _reach(turns, sigma)
    return np.any(np.abs(short) + reach >= 1, axis=-1)


def _reach(turns: Array, sigma: Array) -> tuple[Array, Array, Array]:
    """Return the nearest integers, how far they are, and how far one may be [cycles]; 0 where a phase is missing."""
    nearest = np.round(turns)
    known = np.isfinite(turns) & np.isfinite(sigma)
    return nearest, np.where(known, turns - nearest, 0.0), np.where(known, _DOUBT * sigma, 0.0)


def branch(
    turns: Array, sigma: Array, weights: Array, trial: Index, slot: Index, most: int
) -> tuple[Index, Array, Index]:
    """Return the integers that each hypothesis allows: one where its prediction is sharp, else several.

    Parameters
    ----------
    turns : ndarray, shape (hypotheses, m)
        Predicted minus wrapped phases, in cycles; NaN where a phase is missing.
    sigma : ndarray, shape (hypotheses, m)
        Standard deviation of that [cycles].
    weights : ndarray, shape (hypotheses,)
        Greater than 0.
    trial, slot : ndarray of int, shape (hypotheses,)
        Which trial each belongs to, rising, and its place there.
    most : int
        Places in a trial; of more branches the least likely are cut off.

    Returns
    -------
    parent : ndarray of int, shape (branches,)
        Number of the hypothesis.
    integers : ndarray, shape (branches, m)
        NaN where `turns` is.
    slot : ndarray of int, shape (branches,)
        Place of the branch in its trial: as before where nothing branches.
    """
    nearest, short, reach = _reach(turns, sigma)
    doubt = in_doubt(turns, sigma)
    if not doubt.any():
        return np.arange(trial.size), nearest, slot
    doubtful = np.isin(trial, trial[doubt])

    steps = [np.arange(-_CYCLES, _CYCLES + 1.0)] * turns.shape[-1]
    offsets = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, turns.shape[-1])
    away = short[:, None] - offsets
    parent, option = np.nonzero(((np.abs(away) <= reach[:, None]) | (offsets == 0)).all(axis=-1))
    misfit = away[parent, option] / np.where(reach > 0, sigma, np.inf)[parent]
    score = np.log(weights[parent]) - 0.5 * np.einsum("bi,bi->b", misfit, misfit)
    order = np.lexsort((-score, trial[parent]))
    of_trial = trial[parent[order]]
    rank = np.arange(order.size) - np.searchsorted(of_trial, of_trial)
    # Sums over hypotheses round as these are ordered: no other trial's doubt may change that.
    place = np.where(doubtful[parent[order]], rank, slot[parent[order]])
    chosen, place = order[place < most], place[place < most]
    return parent[chosen], nearest[parent[chosen]] + offsets[option[chosen]], place


def reweigh(weights: Array, log_likelihood: Array, least: float) -> Array:
    """Return Bayes' weights; what falls below `least` is dropped, that is 0 from then on.

    Parameters
    ----------
    weights : ndarray, shape (trials, K)
        0 where there is no hypothesis.
    log_likelihood : ndarray, shape (trials, K)
        Not finite: the hypothesis is dropped.
    least : float
        0 <= least < 1/K.

    Returns
    -------
    ndarray, shape (trials, K)
        Sum 1, or all 0 in a trial with no hypothesis left.
    """
    with np.errstate(divide="ignore"):
        score = np.log(weights) + np.where(np.isfinite(log_likelihood), log_likelihood, -np.inf)
    best = score.max(axis=-1, keepdims=True)
    likely = np.exp(score - np.where(np.isfinite(best), best, 0.0))
    likely = normalised(likely)
    return normalised(np.where(likely >= least, likely, 0.0))


def normalised(weights: Array) -> Array:
    """Return weights (..., K) with sum 1; those that are all 0 stay so."""
    total = weights.sum(axis=-1, keepdims=True)
    return weights / np.where(total > 0, total, 1.0)


def mixture(means: Array, covariances: Array, weights: Array) -> tuple[Array, Array]:
    r"""Return mean and covariance of a Gaussian mixture; where its parts are all alike, theirs to the last bit.

    .. math:: x = x_r + \sum_i w_i\,(x_i - x_r), \qquad
              P = P_r + \sum_i w_i\,[P_i - P_r + (x_i - x)(x_i - x)^T]

    with r the most probable part: the same as :math:`\sum w_i x_i` and
    :math:`\sum w_i [P_i + (x_i - x)(x_i - x)^T]`, for the weights sum to 1.

    Parameters
    ----------
    means, covariances : ndarray, shapes (trials, K, n) and (trials, K, n, n)
        Not looked at where the weight is 0.
    weights : ndarray, shape (trials, K)
        All 0 or NaN in a trial that is lost.

    Returns
    -------
    mean, covariance : ndarray, shapes (trials, n) and (trials, n, n)
        NaN in a trial that is lost.
    """
    trials = np.arange(weights.shape[0])
    alive = weights > 0
    best = np.argmax(np.where(alive, weights, 0.0), axis=-1)
    weight = np.where(alive, weights, 0.0)
    x, p = means[trials, best], covariances[trials, best]
    off = np.where(alive[..., None], means - x[:, None], 0.0)
    wider = np.where(alive[..., None, None], covariances - p[:, None], 0.0)
    mean = x + np.einsum("tk,tki->ti", weight, off)
    apart = np.where(alive[..., None], means - mean[:, None], 0.0)
    spread = np.einsum("tk,tkij->tij", weight, wider) + np.einsum("tk,tki,tkj->tij", weight, apart, apart)
    covariance = p + spread
    lost = ~alive.any(axis=-1)
    if lost.any():
        mean[lost], covariance[lost] = np.nan, np.nan
    return mean, symmetric(covariance)
