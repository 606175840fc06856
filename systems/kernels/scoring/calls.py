"""Normalised errors and sums over trials, called with arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.loading import ready
from quietfix.systems.kernels.sharing import Parts, call
from quietfix.systems.kernels.updating import plain

__all__ = ["add_finite", "normalised"]

Array = NDArray[np.float64]

_NORMALISED = Parts((0, 1, 4), 3, each=0.3)


def normalised(error: Array, covariance: Array, places: NDArray[np.int64]) -> Array:
    """Return e' P^-1 e (trials,) for errors (trials, k) of the `places` (k,) of covariances (trials, n, n).

    NaN where a number is not finite or a variance not above 0; infinity where the covariance is not positive definite
    or not symmetric to rounding, which is for the caller to judge.
    """
    out = np.empty(len(error))
    work = np.empty((places.size + 3, places.size))
    call(
        ready("scoring.nees:normalised"), (plain(error), plain(covariance), places, work, out), len(error), _NORMALISED
    )
    return out


def add_finite(values: Array, trials: int, sums: Array, counts: Array) -> None:
    """Add to sums and counts (k,) what is finite of values (k, trials), or (k, 1) for all, one after the other."""
    ready("scoring.sums:add_finite")(plain(values), trials, sums, counts)
