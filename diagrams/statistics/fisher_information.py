"""What measurements alone say of the state at the start: the Fisher information along a trajectory."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.systems.filters.whitening import Whitener, whitened_jacobian
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel

__all__ = ["Spectrum", "information_roots", "spectrum"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_BETTER = 1 - 1e-6
"""Less than that share of the prior's sigma is better known than it; a start made from the first measurement knows just
as much as that."""

RANK_TOLERANCE = 1e-11
"""A direction whose information is below the square of this share of the best one's is none: what is left of an exact
zero after rounding in Jacobians and transitions."""


def information_roots(
    truth: Array,
    platforms: Array,
    times: ArrayLike,
    model: MeasurementModel,
    motion: MotionModel,
    scale: ArrayLike,
    present: Mask | None = None,
) -> Array:
    r"""Return square roots of the information about the initial state, accumulated from epoch to epoch.

    .. math:: R_k^T R_k = D^T\Big(\sum_{i \le k} \Phi_{i,0}^T H_i^T R^{-1} H_i \Phi_{i,0}\Big) D

    With :math:`D D^T = P_0` the eigenvalues :math:`\lambda` of it are those of the generalised problem
    :math:`G v = \lambda P_0^{-1} v`, G the sum: a direction v of the state has the variance :math:`1/\lambda` from the
    measurements where the prior has 1, and :math:`1/(1 + \lambda)` with both.
    No prior in the sum, no process noise: the Gramian of the linearised system (Jazwinski, *Stochastic Processes and
    Filtering Theory*, 1970, sec. 7.5). Its root is carried by QR, so that weak directions keep the digits that squaring
    loses.

    Parameters
    ----------
    truth : ndarray, shape (trials or 1, time, n)
        States; the Jacobians are taken here. Where a number is NaN no measurement counts.
    platforms : ndarray, shape (trials or 1, time, p, 6)
        Known platforms.
    times : array_like, shape (time,)
        Epochs [s].
    model : MeasurementModel
        Measurement of every epoch, the first included.
    motion : MotionModel
        Its `transition` between the epochs; its process noise is not used.
    scale : array_like, shape (n, n) or (n,)
        D: a square root of the covariance that the information is compared with, in SI units, not singular; or its
        diagonal, > 0.
    present : ndarray of bool, shape (trials or 1, time, m), optional
        Which rows were measured; by default all.

    Returns
    -------
    ndarray, shape (trials, time, n, n)
        Upper triangular.

    Raises
    ------
    ValueError
        If shapes do not fit, or the scale is singular.
    """
    t, unit = np.asarray(times, dtype=float), np.asarray(scale, dtype=float)
    n = motion.size
    if not truth.shape[1] == platforms.shape[1] == t.size:
        raise ValueError(f"epochs of truth, platforms and times are {truth.shape[1]}, {platforms.shape[1]}, {t.size}")
    if truth.shape[-1] != n or unit.shape not in ((n,), (n, n)):
        raise ValueError(f"states of truth, motion and scale are {truth.shape[-1]}, {n}, {unit.shape}")
    unit = np.diag(unit) if unit.ndim == 1 else unit
    if not np.all(np.isfinite(unit)) or np.any(np.diagonal(unit) <= 0):
        raise ValueError(f"scale: {unit.tolist()} is not allowed; finite, and > 0 on the diagonal")
    leading = [truth.shape[0], platforms.shape[0], 1 if present is None else present.shape[0]]
    trials = max(leading)
    if any(count not in (1, trials) for count in leading):
        raise ValueError(f"trials of truth, platforms and present are {leading}; each must be 1 or {trials}")
    varies = type(model).noise_covariance_at is not MeasurementModel.noise_covariance_at
    whitener = Whitener(model.noise_covariance())
    sensitivity: Array = np.broadcast_to(unit, (trials, n, n))  # of the state now to the scaled one at first
    root = np.zeros((trials, n, n))
    found = np.empty((trials, t.size, n, n))
    for k in range(t.size):
        if k > 0:
            sensitivity = motion.transition(truth[:, k - 1], float(t[k] - t[k - 1])) @ sensitivity
        if varies:
            whitener = Whitener(model.noise_covariance_at(truth[:, k], platforms[:, k]))
        seen = None if present is None else present[:, k]
        rows = whitened_jacobian(model.jacobian(truth[:, k], platforms[:, k]), whitener, seen) @ sensitivity
        rows = np.where(np.isfinite(rows), rows, 0.0)
        stacked = np.concatenate([root, np.broadcast_to(rows, (trials, *rows.shape[1:]))], axis=-2)
        root = np.asarray(np.linalg.qr(stacked, mode="r"))
        found[:, k] = root
    return found


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Directions of the scaled initial state, the best known first.

    Attributes
    ----------
    sigma : ndarray, shape (..., n)
        What the measurements leave of a direction: its standard deviation in terms of the scale; infinite where they
        say nothing.
    directions : ndarray, shape (..., n, n)
        Row i: unit vector of direction i in the scaled state.
    """

    sigma: Array
    directions: Array

    @property
    def rank(self) -> NDArray[np.int_]:
        """How many directions the measurements say anything about, shape (...)."""
        return np.count_nonzero(np.isfinite(self.sigma), axis=-1)

    @property
    def known(self) -> NDArray[np.int_]:
        """How many directions they know better than the scale, shape (...)."""
        return np.count_nonzero(self.sigma < _BETTER, axis=-1)

    @property
    def left(self) -> Array:
        """Share of the scale's variance that is left in each direction when both are known, 0 to 1, shape (..., n)."""
        return 1 / (1 + self.sigma**-2.0)

    @property
    def condition(self) -> Array:
        """Condition number of the information, shape (...): infinite where it is singular."""
        with np.errstate(invalid="ignore"):
            return np.where(np.isfinite(self.sigma[..., -1]), (self.sigma[..., -1] / self.sigma[..., 0]) ** 2, np.inf)

    def shares(self, root: ArrayLike | None = None) -> Array:
        r"""Return how much of the variance of each component lies in each direction, shape (..., n, m).

        .. math:: c_{ij}^2 = (D_j w_i)^2 / |D_j|^2, \qquad \sum_i c_{ij}^2 = 1

        the squared correlation of component j with the coordinate along direction i, if the state varies as the scale
        says.

        Parameters
        ----------
        root : array_like, shape (m, n), optional
            D: the scale's square root, each row one component; by default the scale has no correlations.
        """
        if root is None:
            return self.directions**2
        rows = np.asarray(root, dtype=float)
        return (self.directions @ rows.T / np.linalg.norm(rows, axis=-1)) ** 2

    def unknown(self, root: ArrayLike | None = None) -> Array:
        """Return the share of every component, 0 to 1, that lies in directions not better known than the scale."""
        return np.sum(np.where(self.sigma[..., None] < _BETTER, 0.0, self.shares(root)), axis=-2)

    def remaining(self, root: ArrayLike | None = None) -> Array:
        """Return the share of the variance of every component that is left when both are known, shape (..., m)."""
        return np.sum(self.left[..., None] * self.shares(root), axis=-2)


def spectrum(roots: Array) -> Spectrum:
    """Return the directions in which the information is extremal.

    Parameters
    ----------
    roots : ndarray, shape (..., n, n)
        From `information_roots`.
    """
    _, singular, directions = np.linalg.svd(roots)
    empty = singular <= RANK_TOLERANCE * singular[..., :1]
    return Spectrum(np.where(empty, np.inf, 1 / np.where(empty, 1.0, singular)), directions)
