"""Weights of particles, kept as logarithms, and the moments of a weighted cloud.

A cloud is an array (trials, n, particles): the particles along the last axis, so that every component is one run of
memory.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.particles.calls import weighted_moments
from quietfix.systems.linear_algebra import dot

__all__ = ["definite", "effective_size", "moments", "normalise", "unique_sorted"]

Array = NDArray[np.float64]

# A cloud of fewer different particles than its state has components has a singular covariance: with these it is
# definite, and whatever is normalised by it is huge instead of meaningless.
_JITTER = 1e-9
_TINY = 1e-12


def normalise(log_weight: Array) -> tuple[Array, Array]:
    """Return weights that sum to 1, and the logarithm of the sum of the given ones.

    Parameters
    ----------
    log_weight : ndarray, shape (..., N)
        At least one of each trial finite, none +inf.

    Returns
    -------
    weight : ndarray, shape (..., N)
    log_sum : ndarray, shape (...)

    Notes
    -----
    The largest is shifted to 0 first: a sum of exponentials that all underflow is never divided by. (In linear weights
    nearly all particles of a sharp likelihood are exactly 0, and sooner or later all of them.)
    """
    if not log_weight.any():  # after resampling
        count = log_weight.shape[-1]
        return np.full(log_weight.shape, 1 / count), np.full(log_weight.shape[:-1], np.log(count))
    largest = log_weight.max(axis=-1, keepdims=True)
    weight = np.exp(log_weight - largest)
    total = weight.sum(axis=-1, keepdims=True)
    weight /= total
    return weight, (largest + np.log(total))[..., 0]


def effective_size(weight: Array) -> Array:
    r"""Return :math:`1/\sum w^2` of weights (..., N) that sum to 1 (Kong, Liu and Wong, 1994), shape (...)."""
    return 1 / dot(weight, weight)


def moments(cloud: Array, weight: Array | None) -> tuple[Array, Array]:
    """Return mean (trials, n) and covariance (trials, n, n) of a cloud (trials, n, N) with weights (trials, N).

    The covariance is positive definite, also where the cloud has collapsed. Without weights all count the same.
    """
    mean, covariance = weighted_moments(cloud, weight)
    return mean, definite(covariance)


def definite(covariance: Array) -> Array:
    """Make covariances (trials, n, n) of clouds positive definite, also of those that have collapsed; return them."""
    variance = np.einsum("...ii->...i", covariance)
    variance += _JITTER * variance + _TINY
    return covariance


def unique_sorted(rising: Array) -> Array:
    """Return how many different numbers each row (..., N) has that rises."""
    return 1 + np.count_nonzero(rising[..., 1:] != rising[..., :-1], axis=-1)
