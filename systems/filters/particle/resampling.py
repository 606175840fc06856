r"""Resampling schemes: from weights to how often each particle is taken, over trials at once.

All are unbiased, :math:`E\,n_i = N w_i`, and their counts sum to N exactly. Compared by Douc, Cappe and Moulines,
*Comparison of resampling schemes for particle filtering*, ISPA 2005, 64-69; Hol, Schon and Gustafsson, *On resampling
algorithms for particle filters*, NSSPW 2006, 79-82.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.particles.calls import chosen_by, systematic_counts

__all__ = ["SCHEMES", "Scheme", "multinomial", "parents", "residual", "stratified", "systematic"]

Array = NDArray[np.float64]
Counts = NDArray[np.int64]


def _cumulative(weights: Array) -> Array:
    """Return the distribution function of the weights; its last value is exactly 1."""
    total = np.cumsum(weights, axis=-1)
    return total / total[..., -1:]


def _from_edges(edges: Counts) -> Counts:
    """Return the differences of how many points lie below each particle's upper edge."""
    counts = edges.copy()
    counts[..., 1:] -= edges[..., :-1]
    return counts


def systematic(weights: Array, uniform: Array) -> Counts:
    """Take the points (k + u)/N with one u: every count is within one of N w.

    Parameters
    ----------
    weights : ndarray, shape (..., N)
        >= 0, not all zero; they need not sum to 1.
    uniform : ndarray, shape (..., 1)
        In (0, 1).

    Returns
    -------
    ndarray of int, shape (..., N)
    """
    return systematic_counts(weights, uniform)


def stratified(weights: Array, uniform: Array) -> Counts:
    """Take the points (k + u_k)/N: one in each N-th.

    Parameters
    ----------
    weights, uniform : ndarray, shape (..., N)
        See `systematic`.
    """
    n = weights.shape[-1]
    edges = n * _cumulative(weights)
    below = np.minimum(edges.astype(np.int64), n - 1)
    own = np.take_along_axis(np.broadcast_to(uniform, edges.shape), below, axis=-1)
    points = below + (own < edges - below)
    points[..., -1] = n
    return _from_edges(points)


def multinomial(weights: Array, uniform: Array) -> Counts:
    """Take N independent draws.

    Parameters
    ----------
    weights, uniform : ndarray, shape (..., N)
        See `systematic`.
    """
    return _drawn(_cumulative(weights), np.broadcast_to(uniform, weights.shape))


def residual(weights: Array, uniform: Array) -> Counts:
    """Take the whole part of N w for certain, and draw the rest independently from what is left of the weights.

    Liu and Chen, *Sequential Monte Carlo methods for dynamic systems*, J. American Statistical Association 93 (1998)
    1032-1044.

    Parameters
    ----------
    weights, uniform : ndarray, shape (..., N)
        See `systematic`.
    """
    n = weights.shape[-1]
    share = n * weights / np.cumsum(weights, axis=-1)[..., -1:]
    certain = np.floor(share)
    left = share - certain
    draws = n - certain.sum(axis=-1, keepdims=True)
    left = np.where(draws > 0, left, 1.0)  # nothing to draw: any weights will do
    # draws that are not wanted lie beyond the last particle
    wanted = np.arange(n) < draws
    points = np.where(wanted, np.broadcast_to(uniform, weights.shape), 2.0)
    return certain.astype(np.int64) + _drawn(_cumulative(left), points)


def _drawn(cumulative: Array, points: Array) -> Counts:
    """Return how many points fall into each step of the distribution function; those > 1 into none.

    By sorting both together: a search per trial would be a loop over trials, and one search for all would add the
    trial's number to the weights, so that their rounding would depend on the batch.
    """
    n = cumulative.shape[-1]
    order = np.argsort(np.concatenate([cumulative, points], axis=-1), axis=-1, kind="stable")
    is_point = order >= n
    before = np.cumsum(is_point, axis=-1)
    edges = before[~is_point].reshape(cumulative.shape)
    return _from_edges(edges)


class Scheme(NamedTuple):
    """A resampling scheme: ``counts(weights, uniform)``, and how many uniform numbers per trial it needs of N."""

    counts: Callable[[Array, Array], Counts]
    one_number: bool


SCHEMES: dict[str, Scheme] = {
    "systematic": Scheme(systematic, True),
    "stratified": Scheme(stratified, False),
    "residual": Scheme(residual, False),
    "multinomial": Scheme(multinomial, False),
}


def parents(counts: Counts) -> NDArray[np.intp]:
    """Return which particle each new one comes from, rising, shape (..., N).

    Parameters
    ----------
    counts : ndarray of int, shape (..., N)
        They sum to N in each trial.
    """
    return chosen_by(counts)
