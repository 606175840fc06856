"""A window of measurements and the path through it: what it costs, and a step to a better one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.filters.observation import Linearised, Observation, linearised
from quietfix.systems.filters.square_root import Gains
from quietfix.systems.linear_algebra import cholesky, inverse_lower, semidefinite_root, symmetric
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel

__all__ = ["Path", "Window"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Path(NamedTuple):
    """Where a window's states are, as the first one and what pushes the motion after it.

    Attributes
    ----------
    first : ndarray, shape (trials, n)
    pushes : ndarray, shape (trials, epochs, n)
        Standard normal numbers; of the first epoch they push nothing.
    """

    first: Array
    pushes: Array


@dataclass(frozen=True, eq=False)
class Window:
    r"""Epochs, one prior, what was measured at each of them.

    .. math:: J = |L_0^{-1}(x_0 - m_0)|^2 + \sum_k |u_k|^2 + \sum_k |W_k (z_k - h(x_k))|^2, \qquad
              x_k = f(x_{k-1}) + L_k u_k,\quad L_k L_k^T = Q_k

    minus twice the logarithm of the posterior density of the whole path, process noise and all. Written in the pushes u
    it has a meaning for a Q that is singular, or zero.

    Attributes
    ----------
    mean, covariance : ndarray, shapes (trials, n) and (trials, n, n)
        The prior of the first epoch.
    steps : sequence of float
        Time from the epoch before [s]; of the first, and of those that no trial has, 0.
    moves : ndarray of bool, shape (trials, epochs)
        Whether a trial has moved there; where it has not, it stands at its first epoch still.
    observations : sequence of Observation
        Of each epoch.
    model : MeasurementModel
    motion : MotionModel
    noises : sequence of ndarray, shape (n, n) or (trials, n, n)
        Q of each step; it is held while the window is solved.
    """

    mean: Array
    covariance: Array
    steps: Sequence[float]
    moves: Mask
    observations: Sequence[Observation]
    model: MeasurementModel
    motion: MotionModel
    noises: Sequence[Array]

    @cached_property
    def prior_root(self) -> Array:
        """L_0."""
        return cholesky(self.covariance)

    @cached_property
    def roots(self) -> list[Array]:
        """L_k of every epoch, 0 where a trial does not move."""
        n = self.mean.shape[-1]
        found = [np.zeros((1, n, n))]
        for k in range(1, len(self.steps)):
            found.append(np.where(self.moves[:, k, None, None], semidefinite_root(self.noises[k]), 0.0))
        return found

    def states(self, path: Path) -> list[Array]:
        """Return the states (trials, n) of all epochs."""
        states = [path.first]
        for k, step in enumerate(self.steps):
            if k == 0:
                continue
            moved = self.motion.propagate(states[-1], step) if step > 0 else states[-1]
            moved = moved + (self.roots[k] @ path.pushes[:, k, :, None])[..., 0]
            states.append(np.where(self.moves[:, k, None], moved, states[-1]))
        return states

    def looked_at(self, states: Sequence[Array]) -> list[Linearised]:
        """Return what the observations say about states, to first order."""
        return [linearised(one, self.model, state) for one, state in zip(self.observations, states, strict=True)]

    def cost(self, path: Path, seen: Sequence[Linearised]) -> tuple[Array, Array]:
        """Return J of each trial, and how many rows it is made of, both (trials,)."""
        off = (inverse_lower(self.prior_root) @ (path.first - self.mean)[..., None])[..., 0]
        pushed = path.pushes[:, 1:].reshape(len(off), -1)
        total = np.einsum("ti,ti->t", off, off) + np.einsum("ti,ti->t", pushed, pushed)
        rows = np.zeros(len(off))
        for one in seen:
            white = (one.weight @ one.innovation[..., None])[..., 0]
            total = total + np.einsum("ti,ti->t", white, white)
            missing = np.zeros(white.shape, dtype=bool) if one.missing is None else one.missing
            rows = rows + np.count_nonzero(~missing, axis=-1)
        return total, rows

    def step(
        self, path: Path, states: Sequence[Array], seen: Sequence[Linearised], damping: Array
    ) -> tuple[Path, Array]:
        r"""Return the path after a damped Gauss-Newton step, and the last state's covariance about the linearised one.

        The minimum over :math:`\delta` of J linearised plus
        :math:`\lambda (|L_0^{-1}\delta x_0|^2 + \sum|\delta u_k|^2)` is a linear Gaussian smoothing problem, whose
        prior has the mean :math:`(m_0 - x_0)/(1+\lambda)` and the covariance :math:`P_0/(1+\lambda)`, likewise for
        each u: it is solved by one pass forward and one back. Bell, *The iterated
        Kalman smoother as a Gauss-Newton method*, SIAM J. Optimization 4 (1994) 626-636; Sarkka and Svensson,
        *Levenberg-Marquardt and line-search extended Kalman smoothers*, ICASSP 2020.

        Parameters
        ----------
        path, states, seen
            The path, and what `states` and `looked_at` say of it.
        damping : ndarray, shape (trials,)
            lambda, >= 0.
        """
        share = 1 / (1 + damping)
        off = share[:, None] * (self.mean - path.first)
        root = np.sqrt(share)[:, None, None] * self.prior_root
        moves: list[_Move] = []
        for k, one in enumerate(seen):
            if k:
                move, root = self._moved(path, states, k, off, root, share)
                moves.append(move)
                off = move.ahead
            gains = Gains(root, one.weight @ (one.jacobian @ root))
            left = one.innovation - (one.jacobian @ off[..., None])[..., 0]
            off = off + gains.correction((one.weight @ left[..., None])[..., 0])
            root = gains.root()
        pushes = np.zeros_like(path.pushes)
        for k in range(len(moves), 0, -1):
            move = moves[k - 1]
            ahead = (off - move.ahead)[..., None]
            pushes[:, k] = path.pushes[:, k] + move.pushed + (move.to_push @ ahead)[..., 0]
            off = move.before + (move.to_state @ ahead)[..., 0]
        return Path(path.first + off, pushes), root @ np.swapaxes(root, -1, -2)

    def _moved(
        self, path: Path, states: Sequence[Array], k: int, off: Array, root: Array, share: Array
    ) -> tuple[_Move, Array]:
        """Return the move of the correction to epoch `k`, and the root of its covariance there."""
        half = np.sqrt(share)[:, None, None]
        transition, push = self._transition(states, k), half * self.roots[k]
        across = transition @ root
        predicted = symmetric(across @ np.swapaxes(across, -1, -2) + push @ np.swapaxes(push, -1, -2))
        scale = 1 / np.sqrt(np.einsum("...ii->...i", predicted))
        factor = cholesky(predicted * scale[..., :, None] * scale[..., None, :])
        inverse = inverse_lower(factor) * scale[..., None, :]
        pushed = -share[:, None] * path.pushes[:, k]
        ahead = (transition @ off[..., None])[..., 0] + (self.roots[k] @ pushed[..., None])[..., 0]
        to_state = root @ np.swapaxes(inverse @ across, -1, -2) @ inverse
        to_push = half * (np.swapaxes(inverse @ push, -1, -2) @ inverse)
        return _Move(off, ahead, pushed, to_state, to_push), factor / scale[..., :, None]

    def _transition(self, states: Sequence[Array], k: int) -> Array:
        n = self.mean.shape[-1]
        if not self.steps[k] > 0:
            return np.broadcast_to(np.eye(n), (len(self.mean), n, n))
        return np.where(self.moves[:, k, None, None], self.motion.transition(states[k - 1], self.steps[k]), np.eye(n))


class _Move(NamedTuple):
    """How a correction goes from one epoch to the next, and back.

    Attributes
    ----------
    before, ahead : ndarray, shape (trials, n)
        The correction of the earlier state, and what it makes of the later one.
    pushed : ndarray, shape (trials, n)
        Mean of the push's correction.
    to_state, to_push : ndarray, shape (trials, n, n)
        What the later one, once known, says of the earlier one and of the push.
    """

    before: Array
    ahead: Array
    pushed: Array
    to_state: Array
    to_push: Array
