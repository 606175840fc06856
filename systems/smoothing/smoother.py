"""A smoother behind any Gaussian filter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.smoothing.backward import Link, backward, ends, link

__all__ = ["Smoother"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Smoother:
    r"""The Rauch-Tung-Striebel smoother, of the whole interval or of a fixed lag.

    The step from one epoch to the next is a regression :math:`x_+ = A x + a + e, e \sim (0, \Lambda)`, as the filter
    itself makes it: by the motion's derivative, or by sigma points (Sarkka, *Unscented Rauch-Tung-Striebel smoother*,
    IEEE Trans. Automatic Control 53 (2008) 845-849). Nothing but the filter's own means and covariances is looked at:
    what it left out (gates, missing rows) stays left out.

    Parameters
    ----------
    algorithm : GaussianFilter
        The filter.
    motion : MotionModel
        As it believes it to be.
    lag : float, optional
        Measurements count until so long after an epoch [s], >= 0; None: all of them. Those of the last `lag` seconds
        of a run have what there is.

    Raises
    ------
    ValueError
        For a lag that is no such number.
    """

    algorithm: GaussianFilter
    motion: MotionModel
    lag: float | None = None

    def __post_init__(self) -> None:
        """Check the lag."""
        if self.lag is not None and not (math.isfinite(self.lag) and self.lag >= 0):
            raise ValueError(f"lag_s: {self.lag} is not allowed; a finite number >= 0, or null: the whole interval")

    def smooth(self, times: Array, means: Array, covariances: Array, anew: Mask | None = None) -> tuple[Array, Array]:
        """Return means and covariances of all epochs given the later measurements too.

        Parameters
        ----------
        times : ndarray, shape (time,)
            Epochs at which the filter had its measurements [s], increasing.
        means, covariances : ndarray, shapes (time, trials, n) and (time, trials, n, n)
            Of the filter; NaN where a trial has not started, or is lost. There it stays NaN, and what is before counts
            as the end.
        anew : ndarray of bool, shape (time, trials), optional
            Epochs at which the filter has not gone on from what it predicted, but begun again or taken its belief for
            too narrow: what is before counts as the end there, too.

        Returns
        -------
        means, covariances : ndarray, of the same shapes
        """
        if len(times) < 2:
            return means.copy(), covariances.copy()
        known: Any = np.isfinite(means).all(axis=-1) & np.isfinite(covariances).all(axis=(-1, -2))
        there = known[:-1] & known[1:]
        if anew is not None:
            there &= ~anew[1:]
        safe = np.where(known[..., None], means, 1.0)
        spread = np.where(known[..., None, None], covariances, np.eye(means.shape[-1]))
        shape = len(times) - 1, *covariances.shape[1:]
        links, predicted = Link(np.empty(shape), np.empty(shape)), np.empty(shape[:-1])
        motion, held = self.motion, None
        for k, dt in enumerate(np.diff(times).tolist()):
            if self.motion.input_size:
                fresh = self.motion.initial_input(safe[k])
                held = fresh if held is None else np.where(known[k - 1][..., None], held, fresh)
                held = self.motion.next_input(safe[k], held, dt)
                motion = self.motion.driven(held)
            step = self.algorithm.regress(safe[k], spread[k], motion, dt)
            links.gain[k], links.rest[k] = link(spread[k], step.transition, step.noise)
            predicted[k] = step.mean
        found, of = backward(spread, links, ends(times, self.lag), safe, predicted, there)
        assert found is not None
        return np.where(known[..., None], found, means), np.where(known[..., None, None], of, covariances)
