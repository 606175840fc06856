"""The Markov chain by which a target changes from one motion to another."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import expm, logm

__all__ = ["ModeChain"]

Array = NDArray[np.float64]

_ROUNDING = 1e-9
_EMBEDDED = 1e-9  # what a generator's rates may be below 0 by rounding of the logarithm
_HALVINGS = 40


class ModeChain:
    r"""Transition probabilities over any step, from a matrix per stated step or from mean sojourn times.

    With mean sojourn times the chain lives in continuous time: :math:`\Pi(dt) = e^{G\,dt}` with the rates
    :math:`G_{ii} = -1/\tau_i` and :math:`G_{ij} = p_{ij}/\tau_i`. A matrix is a chain of steps; over a multiple of its
    step it is a power, and over any other it is the fractional power where there is one, that is where the logarithm
    of the matrix has no negative rate (the embedding problem).

    Parameters
    ----------
    matrix : array_like, shape (M, M)
        Probabilities, rows sum to 1, if `step` is given; else rates [1/s], rows sum to 0.
    step : float or None
        Step of the matrix [s], > 0.
    """

    def __init__(self, matrix: ArrayLike, step: float | None) -> None:
        self.matrix = np.array(matrix, dtype=float)
        if self.matrix.ndim != 2 or self.matrix.shape[0] != self.matrix.shape[1] or not self.matrix.size:
            raise ValueError(f"transitions of shape {self.matrix.shape} are not allowed; a row and a column per model")
        self.step = step
        if not np.isfinite(self.matrix).all():
            raise ValueError("transitions: a number that is not finite is not allowed")
        if step is not None and not (math.isfinite(step) and step > 0):
            raise ValueError(f"step: {step} is not allowed; a finite number > 0 s")
        target, kind = (0.0, "rates") if step is None else (1.0, "probabilities")
        off = self.matrix - np.diag(np.diag(self.matrix)) if step is None else self.matrix
        if (off < 0).any():
            raise ValueError(f"transitions: {off.min():g} is not allowed; {kind} >= 0")
        for i, total in enumerate(self.matrix.sum(axis=1)):
            if abs(total - target) > _ROUNDING * max(1.0, np.abs(self.matrix[i]).max()):
                raise ValueError(f"transitions: row {i + 1} sums to {total:.10g}; {target:g} is needed")
        self._generator = self.matrix if step is None else _logarithm(self.matrix, step)
        self.over = lru_cache(maxsize=256)(self._over)

    @classmethod
    def of_sojourns(cls, seconds: ArrayLike, follow: ArrayLike | None = None) -> ModeChain:
        """Return the chain that stays `seconds` (M,) in each mode in the mean [s], infinite: for ever.

        `follow` (M, M) says which mode comes next: probabilities, their diagonal is not looked at; by default all
        others are as likely as each other.
        """
        tau = np.array(seconds, dtype=float)
        count = tau.size
        if not (tau > 0).all():
            raise ValueError(f"sojourn times: {tau.min():g} is not allowed; > 0 s")
        if count == 1:
            return cls(np.zeros((1, 1)), None)
        share = np.ones((count, count)) if follow is None else np.array(follow, dtype=float)
        share = share * (1 - np.eye(count))
        share /= share.sum(axis=1, keepdims=True)
        return cls((share - np.eye(count)) / tau[:, None], None)

    @property
    def size(self) -> int:
        """Number of modes."""
        return int(self.matrix.shape[0])

    def _over(self, dt: float) -> Array:
        """Return the transition probabilities (M, M) over `dt` seconds; rows sum to 1.

        Raises
        ------
        ValueError
            If the chain is one of steps, and `dt` is none of them.
        """
        steps = None if self.step is None else dt / self.step
        if steps is not None and abs(steps - round(steps)) <= _ROUNDING * max(1.0, steps):
            found: Array = np.linalg.matrix_power(self.matrix, round(steps))
        elif self._generator is not None:
            found = np.maximum(expm(self._generator * dt), 0.0)
            found /= found.sum(axis=1, keepdims=True)
        else:
            raise ValueError(
                f"transitions: a step of {dt:g} s is not allowed; multiples of {self.step:g} s, for this matrix is no "
                "power of one of a shorter step (mean sojourn times are good for any step)"
            )
        found.setflags(write=False)
        return found

    def long_run(self) -> Array:
        """Return how probable the modes are in the long run (M,), begun from all alike."""
        # half a step and half none: a chain that goes round in a circle settles, too
        matrix = (
            self.matrix if self.step is not None else np.eye(self.size) + self.matrix / max(self._fastest(), 1e-300)
        )
        matrix = 0.5 * (matrix + np.eye(self.size))
        for _ in range(_HALVINGS):
            matrix = matrix @ matrix
            matrix /= matrix.sum(axis=1, keepdims=True)
        share: Array = np.full(self.size, 1 / self.size) @ matrix
        return share / share.sum()

    def _fastest(self) -> float:
        return float(-np.diag(self.matrix).min())


def _logarithm(matrix: Array, step: float) -> Array | None:
    """Return the rates [1/s] of a chain in continuous time that is `matrix` after `step`; None if there is none."""
    if np.linalg.det(matrix) <= 0:
        return None
    rates = logm(matrix) / step
    if np.iscomplexobj(rates):
        if np.abs(rates.imag).max() > _EMBEDDED * max(1.0, np.abs(rates).max()):
            return None
        rates = rates.real
    off = rates - np.diag(np.diag(rates))
    if not np.isfinite(rates).all() or off.min() < -_EMBEDDED / step:
        return None
    off = np.maximum(off, 0.0)
    return off - np.diag(off.sum(axis=1))
