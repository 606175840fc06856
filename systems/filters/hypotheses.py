"""A bank of hypotheses, each with a Gaussian belief and a weight: evidence, weighing, moments."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from systems.filters.linear_algebra import cholesky, symmetric

__all__ = ["log_evidence", "merge", "mixture", "reweigh"]

Array = NDArray[np.float64]


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


def merge(weights: Array, labels: Array) -> Array:
    """Add the weight of hypotheses that have become the same one to the heaviest of them.

    Parameters
    ----------
    weights : ndarray, shape (trials, K)
    labels : ndarray, shape (trials, K, m)
        Hypotheses with equal labels are the same; a NaN equals nothing.

    Returns
    -------
    ndarray, shape (trials, K)
    """
    same = (labels[:, :, None] == labels[:, None, :]).all(axis=-1)
    order = np.argsort(np.argsort(-weights, axis=-1, kind="stable"), axis=-1, kind="stable")
    heavier = same & (order[:, None, :] < order[:, :, None])
    alive = weights > 0
    absorbed = heavier & alive[:, None, :] & alive[:, :, None]
    gone = absorbed.any(axis=-1)
    # Each goes to the heaviest of its kind, which is absorbed by none.
    gained = np.where(absorbed & ~gone[:, None, :], weights[:, :, None], 0.0).sum(axis=1)
    return np.where(gone, 0.0, weights + gained)


def mixture(means: Array, covariances: Array, weights: Array) -> tuple[Array, Array]:
    r"""Return mean and covariance of a Gaussian mixture.

    .. math:: \bar x = \sum_k w_k x_k, \qquad
              \bar P = \sum_k w_k \left[P_k + (x_k - \bar x)(x_k - \bar x)^T\right]

    Parameters
    ----------
    means, covariances : ndarray, shapes (trials, K, n) and (trials, K, n, n)
        Not looked at where the weight is 0.
    weights : ndarray, shape (trials, K)

    Returns
    -------
    mean, covariance : ndarray, shapes (trials, n) and (trials, n, n)
        NaN in a trial whose weights are all 0.
    """
    alive = weights > 0
    x = np.where(alive[..., None], means, 0.0)
    p = np.where(alive[..., None, None], covariances, 0.0)
    mean = np.einsum("tk,tki->ti", weights, x)
    apart = np.where(alive[..., None], x - mean[:, None], 0.0)
    covariance = np.einsum("tk,tkij->tij", weights, p) + np.einsum("tk,tki,tkj->tij", weights, apart, apart)
    lost = ~alive.any(axis=-1)
    if lost.any():
        mean[lost], covariance[lost] = np.nan, np.nan
    return mean, symmetric(covariance)
