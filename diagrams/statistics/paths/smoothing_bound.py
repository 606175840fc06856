"""The posterior Cramer-Rao bound of a smoother along each trial's own truth."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.diagrams.quantities.states import Moves
from quietfix.systems.smoothing.backward import Link, backward, ends, link

__all__ = ["smoothing_bound"]

Array = NDArray[np.float64]


def smoothing_bound(
    filtered: Iterable[Array], course: Array, times: ArrayLike, motion: Moves, lag: float | None
) -> Array:
    r"""Return the bound of every epoch with the later measurements too, shape (time, trials, n, n).

    The Bayesian information of the whole path is that of a linear Gaussian one with the derivatives taken at the truth;
    its block for epoch k, forward from the start and backward from the end, is

    .. math:: P^s_k = P_k + G_k (P^s_{k+1} - P^-_{k+1}) G_k^T, \qquad G_k = P_k \Phi_k^T (P^-_{k+1})^{-1}

    Tichavsky, Muravchik and Nehorai, IEEE Trans. Signal Processing 46 (1998) 1386-1396 (sec. III: the inverse of the
    information of the path); Simandl, Kralovec and Tichavsky, *Filtering, predictive, and smoothing Cramer-Rao bounds*,
    Automatica 37 (2001) 1703-1716.

    Parameters
    ----------
    filtered : iterable of ndarray, shape (trials, n, n)
        The bound of a filter, of one epoch after the other.
    course : ndarray, shape (trials or 1, time, n)
        States at which the motion's derivatives are taken.
    times : array_like, shape (time,)
        Epochs [s].
    motion : Moves
        The motion.
    lag : float, optional
        Measurements count until so long after an epoch [s]; None: all.
    """
    t = np.asarray(times, dtype=float)
    covariances = np.stack(list(filtered))
    known: Any = np.all(np.isfinite(covariances), axis=(-1, -2))
    safe = np.where(known[..., None, None], covariances, np.eye(motion.size))
    shape = t.size - 1, *covariances.shape[1:]
    links = Link(np.empty(shape), np.empty(shape))
    lost = np.zeros((t.size - 1, covariances.shape[1]), dtype=bool)
    for k, dt in enumerate(np.diff(t).tolist()):
        state = course[:, k]
        transition, noise = motion.transition(state, dt), motion.process_noise(state, dt)
        bad: Any = ~(np.isfinite(transition).all(axis=(-1, -2)) & np.isfinite(noise).all(axis=(-1, -2)))
        if np.any(bad):
            stays, still = np.eye(motion.size), np.zeros((motion.size, motion.size))
            transition, noise = (
                np.where(bad[..., None, None], stand, matrix) for stand, matrix in ((stays, transition), (still, noise))
            )
        lost[k] = bad
        links.gain[k], links.rest[k] = link(safe[k], transition, noise)
    there = known[:-1] & known[1:] & ~lost
    _, found = backward(safe, links, ends(t, lag), linked=there)
    return np.where(known[..., None, None], found, np.nan)
