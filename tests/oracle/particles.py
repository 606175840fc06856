"""Steps of particle filters over trials and particles (trials, n, N)."""

import numpy as np

__all__ = ["likelihood", "moments", "moved", "normals", "parents", "systematic"]


def moments(cloud, weight):
    """Return weighted mean and covariance; no weights: all count alike."""
    weight = np.full((cloud.shape[0], cloud.shape[2]), 1 / cloud.shape[2]) if weight is None else weight
    mean = np.einsum("tij,tj->ti", cloud, weight)
    offset = cloud - mean[..., None]
    return mean, np.einsum("tij,tkj,tj->tik", offset, offset, weight)


def systematic(weights, uniform):
    """Return how often each particle is taken."""
    n = weights.shape[-1]
    total = np.cumsum(weights, axis=-1)
    edges = n * (total / total[..., -1:])
    below = edges.astype(np.int64)
    points = below + (uniform < edges - below)
    return np.diff(points, axis=-1, prepend=0)


def parents(counts):
    """Return which particle each new one comes from."""
    return np.stack([np.repeat(np.arange(counts.shape[-1]), row) for row in counts])


def moved(cloud, phi, offset, root, white):
    """Return Phi x + offset + L e."""
    return phi @ cloud + offset[..., None] + root @ white


def likelihood(residual, missing, weight):
    """Return whitened residuals (trials, m, N) and the logarithm of the likelihood (trials, N)."""
    white = weight @ np.where(missing[..., None], 0.0, residual)
    logarithm = -0.5 * (white**2).sum(axis=1)
    possible = np.isfinite(logarithm)
    return np.where(possible[:, None], white, 0.0), np.where(possible, logarithm, -np.inf)


def normals(key, count):
    """Return what NumPy draws."""
    return np.random.Generator(np.random.SFC64(key)).standard_normal(count)
