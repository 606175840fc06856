"""Stacked Cholesky factors that survive a bad trial, and square roots of singular covariances."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["cholesky", "semidefinite_root", "symmetric"]

Array = NDArray[np.float64]

_SMALLEST_EIGENVALUE = 1e-12  # of the correlation matrix, where a covariance has to be repaired


def symmetric(matrix: Array) -> Array:
    """Return the symmetric part over the last two axes."""
    return 0.5 * (matrix + np.swapaxes(matrix, -1, -2))


def cholesky(covariance: Array) -> Array:
    """Return lower Cholesky factors, shape (..., n, n).

    A matrix that is not positive definite to rounding is repaired alone: the eigenvalues of its correlation
    matrix are raised to 1e-12. One with NaN gives NaN; no matrix affects another.
    """
    try:
        return np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        pass
    n = covariance.shape[-1]
    flat = covariance.reshape(-1, n, n)
    factors = np.full_like(flat, np.nan)
    for i, matrix in enumerate(flat):  # the rare path: only when LAPACK refused the batch
        if np.all(np.isfinite(matrix)):
            factors[i] = _repaired(matrix)
    return factors.reshape(covariance.shape)


def _repaired(matrix: Array) -> Array:
    try:
        return np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        pass
    scale = np.sqrt(np.maximum(np.diagonal(matrix), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(symmetric(matrix / np.outer(scale, scale)))
    root = vectors * np.sqrt(np.maximum(values, _SMALLEST_EIGENVALUE))
    # QR turns the square root into a triangular one without squaring it again.
    factor = np.linalg.qr(root.T, mode="r").T
    return scale[:, None] * factor * np.where(np.diagonal(factor) < 0, -1.0, 1.0)


def semidefinite_root(covariance: Array) -> Array:
    """Return A with ``A A^T = covariance`` for a symmetric, possibly singular matrix, shape (..., n, n).

    Rows are scaled to unit variance first, so that metres beside seconds lose nothing.
    """
    scale = np.sqrt(np.einsum("...ii->...i", covariance))
    safe = np.where(scale > 0, scale, 1.0)
    correlation = symmetric(covariance / (safe[..., :, None] * safe[..., None, :]))
    values, vectors = np.linalg.eigh(correlation)
    root = vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]
    return scale[..., :, None] * root
