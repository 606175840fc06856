"""Stacked Cholesky factors that survive a bad trial, and square roots of singular covariances."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "all_finite",
    "cholesky",
    "dot",
    "inverse_lower",
    "inverses",
    "quadratic",
    "semidefinite_root",
    "solve",
    "symmetric",
]

Array = NDArray[np.float64]

_RANK = 1e-13  # share of a variance below which what is left of it is rounding error
_SMALLEST_EIGENVALUE = 1e-12  # of the correlation matrix, where a covariance has to be repaired
_BLOCK = 256  # matrices at a time, so that they stay in the cache
_LONGEST = 8192  # numbers in NumPy's buffer
_ONES = np.ones(4096)


def all_finite(array: Array) -> bool:
    """Return whether every number is finite, as the sum says; numbers whose sum overflows count as not finite."""
    flat = array.ravel()
    # of a few numbers a dot product is the fastest sum
    return math.isfinite(flat.dot(_ONES[: flat.size]) if flat.size <= _ONES.size else flat.sum())


def symmetric(matrix: Array) -> Array:
    """Return the symmetric part over the last two axes."""
    return 0.5 * (matrix + np.swapaxes(matrix, -1, -2))


def quadratic(residual: Array, covariance: Array) -> tuple[Array, Array, Array]:
    r"""Return :math:`r^T S^{-1} r` over the rows of r that are there.

    Parameters
    ----------
    residual : ndarray, shape (..., m)
        r; not finite where a row is missing.
    covariance : ndarray, shape (..., m, m)
        S; not looked at in such rows.

    Returns
    -------
    value, rows : ndarray, shape (...)
        The form, 0 without a row, and how many rows are there.
    kept : ndarray, shape (..., m, m)
        S with unit rows where they are missing.
    """
    there = np.isfinite(residual)
    gone = ~(there[..., :, None] & there[..., None, :])
    kept = np.where(gone, np.eye(residual.shape[-1]), covariance)
    left = np.where(there, residual, 0.0)
    solved = np.linalg.solve(kept, left[..., None])[..., 0]
    return np.einsum("...i,...i->...", left, solved), np.count_nonzero(there, axis=-1).astype(float), kept


def dot(a: Array, b: Array) -> Array:
    """Return the sum of products over the last axis, shape (...), that is the same in a batch as alone.

    NumPy's `einsum` takes longer axes than its buffer piecewise, and cuts those of several trials where it cuts the
    first; here each is cut by itself.
    """
    length = a.shape[-1]
    total: Array = np.einsum("...k,...k->...", a[..., :_LONGEST], b[..., :_LONGEST])
    for begin in range(_LONGEST, length, _LONGEST):
        part = slice(begin, begin + _LONGEST)
        total = total + np.einsum("...k,...k->...", a[..., part], b[..., part])
    return total


def cholesky(covariance: Array) -> Array:
    """Return lower Cholesky factors, shape (..., n, n).

    A matrix that is not positive definite to rounding is repaired alone: the eigenvalues of its correlation
    matrix are raised to 1e-12. One with NaN gives NaN; no matrix affects another.
    """
    try:
        return np.asarray(np.linalg.cholesky(covariance), dtype=float)
    except np.linalg.LinAlgError:
        pass
    n = covariance.shape[-1]
    flat = covariance.reshape(-1, n, n)
    finite = np.all(np.isfinite(flat), axis=(-1, -2))
    factors = np.full_like(flat, np.nan)
    try:
        factors[finite] = np.linalg.cholesky(flat[finite])
    except np.linalg.LinAlgError:
        for i in np.flatnonzero(finite):  # the rare path
            factors[i] = _repaired(flat[i])
    return factors.reshape(covariance.shape)


def _repaired(matrix: Array) -> Array:
    try:
        return np.asarray(np.linalg.cholesky(matrix), dtype=float)
    except np.linalg.LinAlgError:
        pass
    scale = np.sqrt(np.maximum(np.diagonal(matrix), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(symmetric(matrix / np.outer(scale, scale)))
    root = vectors * np.sqrt(np.maximum(values, _SMALLEST_EIGENVALUE))
    # QR turns the square root into a triangular one without squaring it again.
    factor = np.linalg.qr(root.T)[1].T
    return scale[:, None] * factor * np.where(np.diagonal(factor) < 0, -1.0, 1.0)


def inverses(matrix: Array) -> Array:
    """Return inverses (..., n, n); NaN where a matrix is singular, which affects no other."""
    return solve(matrix, None)


def solve(matrix: Array, right: Array | None) -> Array:
    """Return the X with matrix (..., n, n) @ X = right (..., n, k); right None: the inverses.

    NaN where a matrix is singular: NumPy would raise, and one trial's geometry would end all of them.
    """
    try:
        return np.asarray(np.linalg.inv(matrix) if right is None else np.linalg.solve(matrix, right), dtype=float)
    except np.linalg.LinAlgError:
        pass
    n = matrix.shape[-1]
    right = np.eye(n) if right is None else right
    lead = np.broadcast_shapes(matrix.shape[:-2], right.shape[:-2])
    many = np.broadcast_to(matrix, (*lead, n, n)).reshape(-1, n, n)
    sides = np.broadcast_to(right, (*lead, *right.shape[-2:])).reshape(-1, *right.shape[-2:])
    found = np.full(sides.shape, np.nan)
    for i, (one, side) in enumerate(zip(many, sides, strict=True)):  # the rare path
        try:
            found[i] = np.linalg.solve(one, side)
        except np.linalg.LinAlgError:
            continue
    return found.reshape(*lead, *right.shape[-2:])


def inverse_lower(factor: Array) -> Array:
    """Return the inverses of lower triangular matrices, shape (..., n, n); NaN in one stays in it.

    Notes
    -----
    LAPACK is called for one small matrix after the other, and NumPy's interface to it knows nothing of triangles. Here
    a column is eliminated in all matrices at once (Golub and Van Loan, *Matrix Computations*, section 3.1). It is done
    so for a single matrix, too, where LAPACK would be faster: a trial is to be the same alone as among others.
    """
    n = factor.shape[-1]
    flat = factor.reshape(-1, n, n)
    inverse = np.empty(flat.shape)
    for begin in range(0, len(flat), _BLOCK):
        part = slice(begin, begin + _BLOCK)
        inverse[part] = _inverse_last(np.ascontiguousarray(flat[part].transpose(1, 2, 0))).transpose(2, 0, 1)
    return inverse.reshape(factor.shape)


def _inverse_last(factor: Array) -> Array:
    """Return the inverses of lower triangular matrices (n, n, count)."""
    n = len(factor)
    scale = 1 / np.einsum("iit->it", factor)
    unit = factor * scale[:, None]
    inverse = np.zeros_like(factor)
    np.einsum("iit->it", inverse)[...] = scale
    for j in range(n - 1):
        inverse[j + 1 :, : j + 1] -= unit[j + 1 :, j, None] * inverse[j, : j + 1]
    return inverse


def semidefinite_root(covariance: ArrayLike) -> Array:
    """Return the lower triangular L with L L^T = covariance, which may be singular.

    Parameters
    ----------
    covariance : array_like, shape (..., n, n)
        Symmetric positive semidefinite.

    Returns
    -------
    ndarray, shape (..., n, n)

    Raises
    ------
    ValueError
        If the matrix is not finite, not symmetric or has a negative eigenvalue.

    Notes
    -----
    Cholesky's recursion on the matrix scaled to unit diagonal, with a zero column where the pivot vanishes
    (Higham, *Analysis of the Cholesky decomposition of a semi-definite matrix*, 1990). An eigenvalue root
    would not do: where eigenvalues coincide, as in x, y and z of every motion model, it is not unique, and
    the draws would depend on the LAPACK that is installed.
    """
    p = np.asarray(covariance, dtype=float)
    if p.ndim < 2 or p.shape[-1] != p.shape[-2]:
        raise ValueError(f"covariance: shape {p.shape} is not allowed; (..., n, n)")
    if not np.all(np.isfinite(p)):
        raise ValueError("covariance: all elements must be finite")
    n = p.shape[-1]
    variance = np.diagonal(p, axis1=-2, axis2=-1)
    if np.any(variance < 0):
        raise ValueError(f"covariance: a variance is negative ({variance.min():.3g})")
    sigma = np.sqrt(variance)
    scale = np.where(sigma > 0, sigma, 1.0)
    scaled = p / scale[..., :, None] / scale[..., None, :]
    if np.any(np.abs(scaled - np.swapaxes(scaled, -1, -2)) > 1e-9):
        raise ValueError("covariance: it must be symmetric")
    root = np.zeros_like(scaled)
    for j in range(n):
        known = root[..., :, :j] * root[..., j : j + 1, :j]
        column = scaled[..., :, j] - known.sum(axis=-1)
        pivot = column[..., j : j + 1]
        alive = pivot > _RANK
        column = np.where(alive, column / np.sqrt(np.where(alive, pivot, 1.0)), 0.0)
        root[..., j:, j] = column[..., j:]
    if np.any(np.abs(root @ np.swapaxes(root, -1, -2) - scaled) > 1e-6):
        raise ValueError("covariance: it has a negative eigenvalue; it must be positive semidefinite")
    return scale[..., :, None] * root
