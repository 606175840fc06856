"""The one measurement update that every Gaussian filter here shares."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Gains", "Posterior", "statistic"]

Array = NDArray[np.float64]


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


class Gains:
    r"""The update in terms of the prior's Cholesky factor.

    With :math:`P = L L^T` and whitened rows :math:`Y = W H L`, the posterior is

    .. math:: P^+ = L M^{-1} L^T, \quad M = I + Y^T Y, \quad
              \delta = L M^{-1} Y^T W\nu .

    Parameters
    ----------
    root : ndarray, shape (..., n, n)
        L.
    rows : ndarray, shape (..., m, n)
        Y.

    Notes
    -----
    It equals Kalman's (push-through identity), factors a matrix with eigenvalues >= 1, and returns
    :math:`P^+ = A A^T`, symmetric and positive definite by construction.
    """

    def __init__(self, root: Array, rows: Array) -> None:
        self._root = root
        self._rows = rows
        gram = np.swapaxes(rows, -1, -2) @ rows
        n = gram.shape[-1]
        gram[..., np.arange(n), np.arange(n)] += 1.0
        self._gram = gram

    def correction(self, whitened: Array) -> Array:
        """Return the correction of the mean for whitened residuals (..., m)."""
        projected = np.einsum("...mi,...m->...i", self._rows, whitened)
        solved = np.linalg.solve(self._gram, projected[..., None])
        return (self._root @ solved)[..., 0]

    def root(self) -> Array:
        """Return a square root A of the posterior covariance, A A^T (not triangular)."""
        factor = np.linalg.cholesky(self._gram)
        return np.swapaxes(np.linalg.solve(factor, np.swapaxes(self._root, -1, -2)), -1, -2)

    def covariance(self) -> Array:
        """Return the posterior covariance."""
        half = self.root()
        return half @ np.swapaxes(half, -1, -2)


def statistic(rows: Array, whitened: Array) -> Array:
    r"""Return the normalised innovation squared :math:`\nu^T S^{-1}\nu`, shape (...).

    Parameters
    ----------
    rows : ndarray, shape (..., m, n)
        Whitened Jacobian times prior root, Y; :math:`W S W^T = I + Y Y^T`.
    whitened : ndarray, shape (..., m)
        Whitened innovation.
    """
    s = rows @ np.swapaxes(rows, -1, -2)
    m = s.shape[-1]
    s[..., np.arange(m), np.arange(m)] += 1.0
    return np.einsum("...i,...i->...", whitened, np.linalg.solve(s, whitened[..., None])[..., 0])
