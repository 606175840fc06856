"""Rows scaled by the square root of their noise, with missing rows taken out per trial."""

from __future__ import annotations

from copy import copy

import numpy as np
from numpy.typing import NDArray

__all__ = ["Whitener", "missing_rows", "unknown_rows", "whitened_jacobian"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def missing_rows(residual: Array, *more: Array) -> Mask | None:
    """Return which rows (..., m) are not finite in any of the arrays, or None where all rows are there.

    Parameters
    ----------
    residual : ndarray, shape (..., m)
    more : ndarray, shape (..., m) or (..., m, n)
    """
    total = float(np.sum(residual)) + sum(float(np.sum(array)) for array in more)  # finite iff nothing is missing
    if np.isfinite(total):
        return None
    missing = ~np.isfinite(residual)
    for array in more:
        bad = ~np.isfinite(array)
        missing = missing | (np.any(bad, axis=-1) if array.ndim > residual.ndim else bad)
    return missing


def unknown_rows(covariance: Array) -> Mask:
    """Return which rows of a noise covariance (..., m, m) cannot be used, shape (..., m).

    Those whose variance is not finite, and those whose covariance with another that is left is not.
    """
    finite = np.isfinite(covariance)
    unknown = ~np.einsum("...ii->...i", finite)
    gaps = ~finite & ~unknown[..., :, None] & ~unknown[..., None, :]
    return unknown | np.any(gaps, axis=-1)


class Whitener:
    r"""The matrix W with :math:`W R W^T = I`, factored once; missing rows have W = 0.

    After whitening, TDOA in seconds (1e-8) stands beside Hz and radians without loss, and a row that is zero
    carries no information: an update with it equals one without it.

    Parameters
    ----------
    covariance : ndarray, shape (m, m) or (..., m, m)
        R, symmetric positive definite; NaN is allowed in rows that `matrix` is told are missing.

    Raises
    ------
    ValueError
        If R is not positive definite.
    """

    def __init__(self, covariance: Array) -> None:
        self._covariance = np.asarray(covariance, dtype=float)
        m = self._covariance.shape[-1]
        variances = np.einsum("...ii->...i", self._covariance)
        if np.any(variances <= 0):
            raise ValueError("the noise covariance must be positive definite: it has a variance <= 0")
        self._whole = bool(np.isfinite(np.sum(self._covariance)))
        self._diagonal = self._whole and bool(np.all(self._covariance == variances[..., None] * np.eye(m)))
        complete = np.all(np.isfinite(self._covariance), axis=(-1, -2), keepdims=True)
        full = _inverse_root(np.where(complete, self._covariance, np.eye(m)))
        self._full = full if self._whole else np.where(complete, full, np.nan)

    @property
    def covariance(self) -> Array:
        """R, as given."""
        return self._covariance

    def rows(self, which: NDArray[np.intp] | Mask) -> Whitener:
        """Return that of some trials alone; one that all trials share stays as it is."""
        if self._covariance.ndim == 2:
            return self
        some = copy(self)
        some._covariance, some._full = self._covariance[which], self._full[which]
        some._whole = self._whole or bool(np.isfinite(np.sum(some._covariance)))
        return some

    def matrix(self, missing: Mask | None) -> Array:
        """Return W, shape (m, m) or (..., m, m), for rows of which `missing` (..., m) are not there.

        Raises
        ------
        ValueError
            If a row that is there has no finite covariance.
        """
        if missing is None and self._whole:
            return self._full
        if missing is None:
            missing = np.zeros(self._covariance.shape[:-1], dtype=bool)
        if self._diagonal:
            return np.where(missing[..., None], 0.0, self._full)
        # The covariance of the rows that are there is a sub-block of R: factor it with unit rows in the gaps.
        gone = missing[..., :, None] | missing[..., None, :]
        kept = np.where(gone, np.eye(self._covariance.shape[-1]), self._covariance)
        if not np.isfinite(np.sum(kept)):
            raise ValueError("the noise covariance must be finite in every row that is measured")
        return np.where(missing[..., None], 0.0, _inverse_root(kept))


def whitened_jacobian(jacobian: Array, whitener: Whitener, seen: Mask | None = None) -> Array:
    """Return W H, whose square is the Fisher information of one measurement; rows that are missing are 0.

    Parameters
    ----------
    jacobian : ndarray, shape (..., m, n)
        H; a row that is not finite counts as missing.
    whitener : Whitener
        Of the noise.
    seen : ndarray of bool, shape (..., m), optional
        Which rows were measured; by default all.
    """
    missing = missing_rows(jacobian.sum(axis=-1))
    if seen is not None and not seen.all():
        missing = ~seen if missing is None else missing | ~seen
    if missing is not None:
        jacobian = np.where(missing[..., None], 0.0, jacobian)
    return whitener.matrix(missing) @ jacobian


def _inverse_root(covariance: Array) -> Array:
    scale = 1 / np.sqrt(np.einsum("...ii->...i", covariance))
    correlation = covariance * (scale[..., :, None] * scale[..., None, :])
    try:
        root = np.linalg.cholesky(correlation)
    except np.linalg.LinAlgError:
        raise ValueError("the noise covariance must be positive definite: rows are fully correlated") from None
    return np.linalg.inv(root) * scale[..., None, :]
