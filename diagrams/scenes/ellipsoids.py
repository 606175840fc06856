"""Covariances of places as ellipsoids whose axes do not jump from one epoch to the next."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.stats import chi2

__all__ = ["PROBABILITY", "ellipsoids"]

Array = NDArray[np.float64]

PROBABILITY = 0.99
"""That the target is in an ellipsoid where errors are normal and as the estimator believes."""


def ellipsoids(covariance: Array) -> tuple[Array, Array]:
    """Return the axes of the ellipsoids e^T P^-1 e = chi2, which hold a normal error with 99 %.

    With P = V diag(l) V^T the semi-axes are the columns of V, of length sqrt(chi2 l), chi2 the quantile of as many
    degrees of freedom as a place has (Bar-Shalom, Li, Kirubarajan, *Estimation with Applications*, 2001, section
    1.4.15). Which eigenvector is which, and its sign, is free: they are taken so that each is nearest to the same one
    of the epoch before, as motion is drawn between epochs.

    Parameters
    ----------
    covariance : ndarray, shape (epochs, n, n), n = 2 or 3
        Of places [m^2].

    Returns
    -------
    axes : ndarray, shape (epochs, 3, 3)
        Right-handed unit vectors as columns; in two dimensions the third is z.
    lengths : ndarray, shape (epochs, 3)
        Of the semi-axes [m]; NaN where the covariance is not finite, or not positive definite.
    """
    epochs, n = covariance.shape[:2]
    axes, lengths = np.tile(np.eye(3), (epochs, 1, 1)), np.full((epochs, 3), np.nan)
    reach, before = chi2.ppf(PROBABILITY, n), np.eye(3)
    for k in np.flatnonzero(np.isfinite(covariance).all(axis=(1, 2))):
        values, vectors = np.linalg.eigh(covariance[k])
        if values[0] <= 0:
            continue
        likeness = before[:n, :n].T @ vectors
        order = linear_sum_assignment(-np.abs(likeness))[1]
        signs = np.where(likeness[np.arange(n), order] < 0, -1.0, 1.0)
        now = np.eye(3)
        now[:n, :n] = vectors[:, order] * signs
        if np.linalg.det(now) < 0:  # a mirror image is no rotation; the ellipsoid is the same
            now[:, 0] *= -1
        axes[k], before = now, now
        lengths[k] = 0.0
        lengths[k, :n] = np.sqrt(reach * values[order])
    return axes, lengths
