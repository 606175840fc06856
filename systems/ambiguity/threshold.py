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


def confidence(peak: ArrayLike, delays: ArrayLike, frequencies: ArrayLike) -> Array:
    r"""Return the chance that noise alone stays below a peak, everywhere in the window.

    A peak is sought between the cells as well, which makes noise more dangerous than M independent cells would be: of
    a smooth complex Gaussian field the expected number of excursions above u times its mean power is

    .. math:: E = \left[1 + \sqrt{\pi u/3}\,(m + n) + \tfrac{\pi}{3}(u - \tfrac12)\,m n\right] e^{-u}

    over m by n cells (Worsley, *Local maxima and the expected Euler characteristic of excursion sets of chi-squared, F
    and t fields*, Adv. Appl. Probab. 26 (1994) 13), and the chance of none is exp(-E) where that is rare.

    Parameters
    ----------
    peak : array_like, shape (...)
        Highest power over the mean noise power.
    delays, frequencies : array_like, shape (...)
        m and n: width of the window along the two axes, in cells.
    """
    u = np.maximum(np.asarray(peak, dtype=float), 0.5)
    m, n = np.asarray(delays, dtype=float), np.asarray(frequencies, dtype=float)
    excursions = 1 + np.sqrt(np.pi * u / 3) * (m + n) + np.pi / 3 * (u - 0.5) * m * n
    return np.exp(-excursions * np.exp(-u))
