"""Rotating phasors, made from two short tables."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["phasor"]

_TABLE = 256


def phasor(rate: NDArray[np.float64], first: float, size: int) -> NDArray[np.complex64]:
    """Return ``exp(2j pi rate (first + n))`` for n = 0 ... size - 1.

    Parameters
    ----------
    rate : ndarray, shape (trials,)
        Cycles per sample.
    first : float
        Where n = 0 is, in samples.
    size : int
        Number of samples.

    Returns
    -------
    ndarray of complex64, shape (trials, size)
    """
    rows = -(-size // _TABLE)
    # whole cycles are taken off in double precision, before anything is rounded
    coarse = np.exp(2j * np.pi * np.fmod(rate[:, None] * (first + _TABLE * np.arange(rows)), 1.0))
    fine = np.exp(2j * np.pi * rate[:, None] * np.arange(_TABLE))
    product = coarse.astype(np.complex64)[:, :, None] * fine.astype(np.complex64)[:, None, :]
    return product.reshape(rate.size, -1)[:, :size]
