r"""Where the cross-ambiguity function fails: the chance that noise makes a higher peak than the signal.

Noise cells hold exponentially distributed powers, the signal's cell a Rician one about :math:`\rho` (both over the
mean noise power). Among M cells the right one wins with

.. math:: P = \int_0^\infty (1 - e^{-u})^M\, e^{-(u+\rho)} I_0(2\sqrt{u\rho})\,du .
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import i0e

__all__ = ["cells", "confidence", "right_cell_probability"]

Array = NDArray[np.float64]

_POINTS = 400


def cells(half_delay: ArrayLike, half_frequency: ArrayLike, bandwidth: float, duration: float) -> Array:
    """Return how many independent cells a window has.

    Parameters
    ----------
    half_delay, half_frequency : array_like, shape (...)
        Half-widths of the window [s], [Hz].
    bandwidth : float
        Noise bandwidth [Hz].
    duration : float
        Integration time [s].
    """
    delays = 2 * np.asarray(half_delay, dtype=float) * bandwidth
    return np.maximum(delays, 1.0) * np.maximum(2 * np.asarray(half_frequency, dtype=float) * duration, 1.0)


def right_cell_probability(rho: ArrayLike, count: ArrayLike) -> Array:
    """Return P: the chance that the highest of all cells is the signal's.

    Parameters
    ----------
    rho : array_like, shape (...)
        Power of the peak over the mean noise power, >= 0; half of B T gamma.
    count : array_like, shape (...)
        M, see `cells`.

    Returns
    -------
    ndarray, shape (...)
    """
    amplitude = np.sqrt(np.asarray(rho, dtype=float))[..., None]
    count = np.asarray(count, dtype=float)[..., None]
    # the Rician density in r = sqrt(u) has unit scale: seven of them on both sides hold all of it
    reach = np.linspace(-7.0, 7.0, _POINTS)
    r = np.maximum(amplitude + reach, 0.0)
    density = 2 * r * np.exp(-np.square(r - amplitude)) * i0e(2 * r * amplitude)
    with np.errstate(divide="ignore"):
        wins = np.exp(count * np.log1p(-np.exp(-np.square(r))))
    total = np.trapezoid(density, r, axis=-1)
    return np.trapezoid(density * wins, r, axis=-1) / total


def confidence(peak: ArrayLike, count: ArrayLike) -> Array:
    """Return the chance that noise alone stays below a peak that was found in all cells, ``(1 - exp(-peak))**M``.

    Parameters
    ----------
    peak : array_like, shape (...)
        Highest power over the mean noise power.
    count : array_like, shape (...)
        M, see `cells`.
    """
    peak = np.maximum(np.asarray(peak, dtype=float), 0.0)
    with np.errstate(divide="ignore"):
        return np.exp(np.asarray(count, dtype=float) * np.log1p(-np.exp(-peak)))
