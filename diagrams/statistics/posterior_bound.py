"""The posterior Cramer-Rao bound along each trial's own truth: the recursion, one epoch after the other."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.diagrams.quantities.states import Moves
from quietfix.systems.counting import tally
from quietfix.systems.filters.square_root import Gains
from quietfix.systems.filters.whitening import Whitener, whitened_jacobian
from quietfix.systems.linear_algebra import cholesky, symmetric
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["bound_steps", "posterior_bound"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_ROUNDING = 1e-9  # s, by which an arrival may miss an epoch


def posterior_bound(
    truth: Array,
    platforms: Array,
    times: ArrayLike,
    model: MeasurementModel,
    motion: Moves,
    start_covariance: Array,
    first_epoch_used: bool,
    present: Mask | None = None,
    flown: Array | None = None,
) -> Array:
    r"""Return the posterior Cramer-Rao bound of every trial at every epoch.

    .. math:: J_{k+1} = (\Phi_k J_k^{-1} \Phi_k^T + Q_k)^{-1} + H_{k+1}^T R^{-1} H_{k+1}, \qquad P_k = J_k^{-1}

    Tichavsky, Muravchik and Nehorai, *Posterior Cramer-Rao bounds for discrete-time nonlinear filtering*, IEEE Trans.
    Signal Processing 46 (1998) 1386-1396, eq. (34), with the expectations replaced by their value along the trial's own
    truth.

    Parameters
    ----------
    truth : ndarray, shape (trials or 1, time, n)
        States; the Jacobians are taken here. Where a number is NaN no measurement counts.
    platforms : ndarray, shape (trials or 1, time, p, 6)
        Known platforms.
    times : array_like, shape (time,)
        Every epoch, not only those that are stored [s].
    model : MeasurementModel
        Measurement of every epoch.
    motion : MotionModel or CarriedMotion
        Motion between the epochs; its process noise may be zero.
    start_covariance : ndarray, shape (trials or 1, n, n) or (n, n)
        At the first epoch.
    first_epoch_used : bool
        True: the first epoch's measurement is already in the start.
    present : ndarray of bool, shape (trials or 1, time, m), optional
        Which rows were measured; by default all.
    flown : ndarray, shape (trials or 1, time, k), optional
        States at which the motion's derivatives are taken, where those are of other components; by default `truth`.

    Returns
    -------
    ndarray, shape (trials, time, n, n)
        Covariances: the bound after the measurement of the epoch; NaN in a trial that cannot be computed.
    """
    steps = bound_steps(truth, platforms, times, model, motion, start_covariance, first_epoch_used, present, flown)
    return np.stack(list(steps), axis=1)


def bound_steps(
    truth: Array,
    platforms: Array,
    times: ArrayLike,
    model: MeasurementModel,
    motion: Moves,
    start_covariance: Array,
    first_epoch_used: bool,
    present: Mask | None = None,
    flown: Array | None = None,
    arrival: Array | None = None,
) -> Iterator[Array]:
    """Yield the bound (trials, n, n) of one epoch after the other; see `posterior_bound`.

    With `arrival` (trials or 1, time, m), when each row comes [s], it is that of what has come by then; NaN while what
    the start is made of has not.
    """
    tally("bounded")
    t = np.asarray(times, dtype=float)
    start = np.asarray(start_covariance, dtype=float)
    start = start if start.ndim == 3 else start[None]
    leading = [truth.shape[0], platforms.shape[0], start.shape[0], 1 if present is None else present.shape[0]]
    trials = max(leading)
    if any(count not in (1, trials) for count in leading):
        raise ValueError(f"trials of truth, platforms, start and present are {leading}; each must be 1 or {trials}")
    if not truth.shape[1] == platforms.shape[1] == t.size:
        raise ValueError(f"epochs of truth, platforms and times are {truth.shape[1]}, {platforms.shape[1]}, {t.size}")
    if start.shape[-1] != motion.size:
        raise ValueError(f"the start has {start.shape[-1]} states, the motion model {motion.size}")

    recursion = _Recursion(truth, platforms, t, model, motion, present, truth if flown is None else flown)
    covariance, lost = _without_lost(np.broadcast_to(start, (trials, *start.shape[1:])), np.zeros(trials, dtype=bool))
    if arrival is not None:
        yield from _late_steps(recursion, cholesky(covariance), lost, first_epoch_used, arrival)
        return
    root = cholesky(covariance)
    for k in range(t.size):
        if k > 0:
            root, lost = recursion.moved(root, lost, k)
        if k > 0 or not first_epoch_used:
            root = recursion.informed(root, k, None if present is None else present[:, k])
        yield np.where(lost[:, None, None], np.nan, root @ np.swapaxes(root, -1, -2))


def _late_steps(
    recursion: _Recursion, root: Array, lost: Mask, first_epoch_used: bool, arrival: Array
) -> Iterator[Array]:
    """Yield the bound with what has arrived by each epoch, from the last one of which everything has."""
    t, present = recursion.times, recursion.present
    seen = np.broadcast_to(True, arrival.shape) if present is None else present & np.isfinite(arrival)
    trials = max(len(root), len(seen))
    root, lost = np.broadcast_to(root, (trials, *root.shape[1:])), np.broadcast_to(lost, (trials,))
    due = np.searchsorted(t, np.where(np.isfinite(arrival), arrival, t[-1]) - _ROUNDING)
    oldest = int((due - np.arange(t.size)[:, None]).max(initial=0))
    spent = np.where(seen[:, 0], arrival[:, 0], -np.inf).max(axis=-1) if first_epoch_used else np.array([-np.inf])
    base, known = -1, (root, lost)  # with all of the epochs up to `base`

    def after(so_far: tuple[Array, Mask], j: int, k: int) -> tuple[Array, Mask]:
        root, lost = recursion.moved(*so_far, j) if j > 0 else so_far
        if j > 0 or not first_epoch_used:
            root = recursion.informed(root, j, seen[:, j] & (arrival[:, j] <= t[k] + _ROUNDING))
        return root, lost

    for k in range(t.size):
        while base < k - oldest - 1:
            base += 1
            known = after(known, base, k)
        root, lost = known
        for j in range(base + 1, k + 1):
            root, lost = after((root, lost), j, k)
        nothing = lost | (spent > t[k] + _ROUNDING)
        yield np.where(nothing[:, None, None], np.nan, root @ np.swapaxes(root, -1, -2))


class _Recursion:
    """The two steps of the recursion; it carries a square root of the covariance.

    A prior of nearly rank one then loses no digits, and stays definite where there is no process noise.
    """

    def __init__(
        self,
        truth: Array,
        platforms: Array,
        times: Array,
        model: MeasurementModel,
        motion: Moves,
        present: Mask | None,
        course: Array,
    ) -> None:
        self.times, self.present = times, present
        self._truth, self._platforms, self._course = truth, platforms, course
        self._model, self._motion = model, motion
        self._varies = type(model).noise_covariance_at is not MeasurementModel.noise_covariance_at
        self._whitener = Whitener(model.noise_covariance())

    def moved(self, root: Array, lost: Mask, k: int) -> tuple[Array, Mask]:
        """Return the root at epoch `k`, from that of the one before, and which trials are lost by now."""
        state, dt = self._course[:, k - 1], float(self.times[k] - self.times[k - 1])
        noise = self._motion.process_noise(state, dt)
        root, lost = _without_lost(self._motion.transition(state, dt) @ root, lost)
        if np.any(noise):
            covariance, lost = _without_lost(symmetric(root @ np.swapaxes(root, -1, -2)) + noise, lost)
            root = cholesky(covariance)
        return root, lost

    def informed(self, root: Array, k: int, seen: Mask | None) -> Array:
        """Return the root with the rows of epoch `k` that are `seen` (trials or 1, m)."""
        truth, platforms, whitener = self._truth[:, k], self._platforms[:, k], self._whitener
        if self._varies:
            whitener = Whitener(self._model.noise_covariance_at(truth, platforms))
        rows = whitened_jacobian(self._model.jacobian(truth, platforms), whitener, seen) @ root
        return Gains(root, rows).root()


def _without_lost(matrices: Array, lost: Mask) -> tuple[Array, Mask]:
    """Return matrices (trials, n, n) with a stand-in where one is not finite, and which trials are lost by now."""
    broken = ~np.all(np.isfinite(matrices), axis=(-1, -2), keepdims=True)[:, 0, 0]
    if not broken.any():
        return matrices, lost
    return np.where(broken[:, None, None], np.eye(matrices.shape[-1]), matrices), lost | broken
