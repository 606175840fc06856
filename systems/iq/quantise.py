"""Quantisation of I/Q samples to few bits."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["quantise"]


def quantise(samples: NDArray[np.complexfloating], bits: int, full_scale: float = 4.0) -> NDArray[np.complexfloating]:
    """Round I and Q to the middle of one of ``2**bits`` steps of equal width.

    Parameters
    ----------
    samples : ndarray of complex, shape (..., samples)
        NaN stays NaN.
    bits : int
        Of each of I and Q, 1 to 24. One bit keeps the signs only.
    full_scale : float
        What is beyond this many standard deviations of I and Q is clipped, > 0. The standard deviation is that of the
        block, measured for each of the leading axes: the scale goes along with the block.

    Returns
    -------
    ndarray of complex, shape (..., samples)
        In the units of `samples`.

    Raises
    ------
    ValueError
        If an argument is not allowed.
    """
    if not (isinstance(bits, int | np.integer) and 1 <= bits <= 24):
        raise ValueError(f"bits: {bits!r} is not allowed; a whole number from 1 to 24")
    if not (math.isfinite(full_scale) and full_scale > 0):
        raise ValueError(f"full_scale: {full_scale} is not allowed; a finite number > 0")
    parts = np.stack([samples.real, samples.imag])
    power = np.mean(parts[0] ** 2 + parts[1] ** 2, axis=-1, keepdims=True) / 2
    step = 2 * full_scale * np.sqrt(power) / 2**bits
    last = 2.0 ** (bits - 1) - 1
    levels = np.floor(parts / np.where(step > 0, step, 1.0))
    real, imaginary = (np.clip(levels, -last - 1, last) + 0.5) * step
    return real + 1j * imaginary
