"""Rows scaled by the square root of their noise, with missing rows taken out per trial."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from systems.filters.linear_algebra import cholesky

__all__ = ["Whitener", "missing_rows"]

Array = NDArray[np.float64]


def missing_rows(*arrays: Array) -> NDArray[np.bool_] | None:
    """Return which rows are not finite in any of the arrays (..., m), or None where all rows are there."""
    total = sum(float(np.sum(array)) for array in arrays)  # one pass: a sum is finite iff nothing is missing
    if np.isfinite(total):
        return None
    missing = ~np.isfinite(arrays[0])
    for array in arrays[1:]:
        missing = missing | ~np.isfinite(array)
    return missing


class Whitener:
    r"""The matrix W with :math:`W R W^T = I`, factored once; missing rows have W = 0.

    After whitening, TDOA in seconds (1e-8) stands beside Hz and radians without loss, and a row that is zero
    carries no information: an update with it equals one without it.

    Parameters
    ----------
    covariance : ndarray, shape (m, m) or (..., m, m)
        R, symmetric positive definite.

    Raises
    ------
    ValueError
        If R is not positive definite.
    """

    def __init__(self, covariance: Array) -> None:
        self._covariance = np.asarray(covariance, dtype=float)
        variances = np.einsum("...ii->...i", self._covariance)
        finite = np.isfinite(variances)
        if np.any(variances[finite] <= 0):
            raise ValueError("the noise covariance must be positive definite: it has a variance <= 0")
        self._diagonal = bool(np.all(self._covariance == variances[..., None] * np.eye(self._covariance.shape[-1])))
        self._full = self._inverse_root(self._covariance)

    @staticmethod
    def _inverse_root(covariance: Array) -> Array:
        scale = 1 / np.sqrt(np.einsum("...ii->...i", covariance))
        correlation = covariance * (scale[..., :, None] * scale[..., None, :])
        return np.linalg.inv(cholesky(correlation)) * scale[..., None, :]

    def matrix(self, missing: NDArray[np.bool_] | None) -> Array:
        """Return W, shape (m, m) or (..., m, m), for rows of which `missing` (..., m) are not there."""
        if missing is None:
            return self._full
        if self._diagonal and np.all(np.isfinite(self._full)):
            return np.where(missing[..., None], 0.0, self._full)
        # The covariance of the rows that are there is a sub-block of R: factor it with unit rows in the gaps.
        m = self._covariance.shape[-1]
        gone = missing[..., :, None] | missing[..., None, :]
        kept = np.where(gone, np.eye(m), self._covariance)
        return np.where(missing[..., None], 0.0, self._inverse_root(kept))
