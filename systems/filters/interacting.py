r"""Interacting multiple models: what the filters of several motions tell each other from step to step.

Blom and Bar-Shalom, *The interacting multiple model algorithm for systems with Markovian switching coefficients*, IEEE
Trans. Automatic Control 33 (1988) 780-783; Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking
and Navigation*, 2001, section 11.6.6. With :math:`\mu_i` the probability that model i holds and :math:`\pi_{ij}` that
model j follows it:

.. math:: c_j = \sum_i \pi_{ij}\,\mu_i, \qquad \mu_{i|j} = \pi_{ij}\,\mu_i / c_j, \qquad
          x_{0j} = \sum_i \mu_{i|j}\,x_i, \qquad
          P_{0j} = \sum_i \mu_{i|j}\,[P_i + (x_i - x_{0j})(x_i - x_{0j})^T]

Filter j goes on from these moments; its likelihood :math:`\Lambda_j` gives :math:`\mu_j \propto \Lambda_j c_j`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.linear_algebra import cholesky

__all__ = ["finite_models", "innovation_likelihood", "mixed", "updated_probabilities"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def finite_models(means: Array, covariances: Array) -> Mask:
    """Return which models' beliefs are finite, shape (trials, M), from (trials, M, n) and (trials, M, n, n)."""
    return np.asarray(np.isfinite(means).all(axis=-1) & np.isfinite(covariances).all(axis=(-1, -2)))


def mixed(means: Array, covariances: Array, probabilities: Array, transition: Array) -> tuple[Array, Array, Array]:
    """Return what the filters go on from after a step of the chain.

    Parameters
    ----------
    means, covariances : ndarray, shapes (trials, M, n) and (trials, M, n, n)
        Not looked at where the probability is 0.
    probabilities : ndarray, shape (trials, M)
        NaN in a trial that is lost.
    transition : ndarray, shape (M, M)
        From the row's model to the column's; rows sum to 1.

    Returns
    -------
    means, covariances, probabilities : ndarray
        In the same shapes. A model that none can become keeps its belief, with probability 0.
    """
    count = probabilities.shape[-1]
    alive = probabilities > 0
    x = np.where(alive[..., None], means, 0.0)
    p = np.where(alive[..., None, None], covariances, 0.0)
    joint = probabilities[:, :, None] * transition
    follow = joint.sum(axis=1)
    share = joint / np.where(follow > 0, follow, 1.0)[:, None]
    new_means, new_covariances = np.empty_like(means), np.empty_like(covariances)
    for j in range(count):
        weight = share[:, :, j]
        mean = np.einsum("ti,tin->tn", weight, x)
        apart = np.where(alive[..., None], x - mean[:, None], 0.0)
        spread = np.einsum("ti,tinm->tnm", weight, p)
        if count > 1:
            spread = spread + np.einsum("ti,tin,tim->tnm", weight, apart, apart)
        kept = ~(follow[:, j] > 0)
        new_means[:, j] = np.where(kept[:, None], means[:, j], mean)
        new_covariances[:, j] = np.where(kept[:, None, None], covariances[:, j], spread)
    return new_means, new_covariances, follow


def innovation_likelihood(prior: Array, posterior: Array, nis: Array) -> Array:
    r"""Return the logarithm of the density of an innovation, up to what all models have in common.

    .. math:: \ln \Lambda = -\tfrac12\,(\nu^T S^{-1} \nu + \ln|S|), \qquad
              \ln|S| = \ln|R| + \ln|P^-| - \ln|P^+|

    The second holds for any update by :math:`K = P^- H^T S^{-1}` (the determinants of both sides of
    :math:`P^+ = (I - K H) P^-`); R is that of the rows that are there, and the same for all models.

    Parameters
    ----------
    prior, posterior : ndarray, shape (k, n, n)
        Covariances before and after, finite.
    nis : ndarray, shape (k,)
        NaN where there was no row.

    Returns
    -------
    ndarray, shape (k,)
    """
    narrowed = np.zeros(prior.shape[0])
    for matrix, sign in ((posterior, 1.0), (prior, -1.0)):
        with np.errstate(divide="ignore", invalid="ignore"):
            narrowed += sign * np.log(np.einsum("kii->ki", cholesky(matrix))).sum(axis=-1)
    return np.where(np.isnan(nis), 0.0, narrowed - 0.5 * np.where(np.isnan(nis), 0.0, nis))


def updated_probabilities(probabilities: Array, log_likelihood: Array) -> Array:
    """Return Bayes' probabilities (trials, M) in logarithms, so that none is lost to underflow before it is compared.

    Parameters
    ----------
    probabilities : ndarray, shape (trials, M)
    log_likelihood : ndarray, shape (trials, M)
        Minus infinity for a model whose filter is lost; NaN in a trial without any model left.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        score = np.log(probabilities) + log_likelihood
        best = score.max(axis=-1, keepdims=True)
        likely = np.exp(score - best)
        result: Array = likely / likely.sum(axis=-1, keepdims=True)
    return result
