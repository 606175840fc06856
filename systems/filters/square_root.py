"""The one measurement update that every Gaussian filter here shares."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.linear_algebra import cholesky, inverse_lower

__all__ = ["Gains", "Posterior", "report"]

Array = NDArray[np.float64]

_WIDE = 1e8  # the weakest direction keeps eight digits


class Posterior(NamedTuple):
    """Result of a measurement update.

    Attributes
    ----------
    mean : ndarray, shape (..., n)
    covariance : ndarray, shape (..., n, n)
    innovation : ndarray, shape (..., m)
        Measured minus predicted; NaN in missing rows.
    nis : ndarray, shape (...,)
        Normalised innovation squared over the rows used; NaN where there were none.
    nis_dof : ndarray, shape (...,)
        Number of rows used.
    """

    mean: Array
    covariance: Array
    innovation: Array
    nis: Array
    nis_dof: Array


def report(
    mean: Array, covariance: Array, innovation: Array, nis: Array, missing: NDArray[np.bool_] | None
) -> Posterior:
    """Return the posterior: NaN for the innovation of rows that are missing (trials, m), and the others counted."""
    if missing is None:
        return Posterior(mean, covariance, innovation, nis, np.full(mean.shape[0], float(innovation.shape[-1])))
    used = np.count_nonzero(~missing, axis=-1).astype(float)
    return Posterior(mean, covariance, np.where(missing, np.nan, innovation), np.where(used > 0, nis, np.nan), used)


class Gains:
    r"""The update in terms of the prior's Cholesky factor.

    With :math:`P = L L^T` and whitened rows :math:`Y = W H L`, the posterior is

    .. math:: P^+ = L M^{-1} L^T, \quad M = I + Y^T Y, \quad
              \delta = L\,y, \quad y = M^{-1} Y^T r = \arg\min_y |r - Y y|^2 + |y|^2, \quad r = W\nu .

    Parameters
    ----------
    root : ndarray, shape (..., n, n)
        L.
    rows : ndarray, shape (..., m, n)
        Y.

    Attributes
    ----------
    rows : ndarray
        Y.

    Notes
    -----
    It equals Kalman's (push-through identity), factors a matrix with eigenvalues >= 1, and returns
    :math:`P^+ = A A^T`, symmetric and positive definite by construction. The minimum of the least squares problem
    is the normalised innovation squared :math:`\nu^T S^{-1}\nu`.

    Forming M loses what lies below :math:`10^{-16}|Y|^2` of 1. Where the prior is that wide against the noise, the
    problem is factored as it stands, :math:`[Y; I] = Q M_u` (Golub and Van Loan, *Matrix Computations*, ch. 5):
    slower, and good to :math:`10^{-16}|Y|`.
    """

    def __init__(self, root: Array, rows: Array) -> None:
        self._root = root
        self.rows = rows
        self._columns = np.ascontiguousarray(np.swapaxes(rows, -1, -2))
        gram = self._columns @ rows
        n = gram.shape[-1]
        gram.reshape(*gram.shape[:-2], n * n)[..., :: n + 1] += 1.0
        self._gram = gram
        self._wide: NDArray[np.bool_] | None = None
        if (gram > _WIDE).any():  # not its maximum, which a NaN in another trial would hide
            self._factor_wide(n)

    def _factor_wide(self, n: int) -> None:
        # no element of a positive definite matrix exceeds its largest diagonal one
        self._wide = np.any(self._gram > _WIDE, axis=(-1, -2))
        rows = self.rows[self._wide]
        stacked = np.concatenate([rows, np.broadcast_to(np.eye(n), (*rows.shape[:-2], n, n))], axis=-2)
        orthogonal, self._upper = np.linalg.qr(stacked)
        self._orthogonal = orthogonal[..., : rows.shape[-2], :]
        self._gram[self._wide] = np.eye(n)

    @cached_property
    def _inverse(self) -> Array:
        """The inverse of M's lower triangular factor."""
        factor = cholesky(self._gram)
        if self._wide is not None:
            factor[self._wide] = np.swapaxes(self._upper, -1, -2)
        return inverse_lower(factor)

    def correction(self, whitened: Array) -> Array:
        """Return the correction of the mean for whitened residuals (..., m).

        One right-hand side is solved for faster than M is factored and inverted, which only `update` and the
        covariance need.
        """
        y = np.linalg.solve(self._gram, self._columns @ whitened[..., None]).astype(float, copy=False)
        if self._wide is not None:
            projected = np.swapaxes(self._orthogonal, -1, -2) @ whitened[self._wide][..., None]
            y[self._wide] = np.linalg.solve(self._upper, projected)
        corrected: Array = (self._root @ y)[..., 0]
        return corrected

    def update(self, whitened: Array) -> tuple[Array, Array]:
        """Return the correction of the mean, and the normalised innovation squared, for a whitened innovation."""
        right = whitened[..., None]
        projected = self._inverse @ (self._columns @ right)
        if self._wide is not None:
            projected[self._wide] = np.swapaxes(self._orthogonal, -1, -2) @ right[self._wide]
        y = np.swapaxes(self._inverse, -1, -2) @ projected
        left = (right - self.rows @ y)[..., 0]
        nis = np.einsum("...i,...i->...", left, left) + np.einsum("...ij,...ij->...", y, y)
        return (self._root @ y)[..., 0], nis

    def root(self) -> Array:
        """Return a square root A of the posterior covariance, A A^T (not triangular)."""
        return self._root @ np.swapaxes(self._inverse, -1, -2)

    def covariance(self) -> Array:
        """Return the posterior covariance."""
        half = self.root()
        covariance = half @ np.swapaxes(half, -1, -2)
        if self._wide is not None:
            # The product's own rounding, at most n eps sigma_i sigma_j, can exceed what is narrow in such a matrix.
            n = covariance.shape[-1]
            inflation = np.where(self._wide, n**2 * np.finfo(float).eps, 0.0)
            covariance += inflation[..., None, None] * covariance * np.eye(n)
        return covariance
