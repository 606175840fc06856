r"""Whether two sample clocks run at one pace: TDOA against time, against what FDOA says it should be.

A receiver whose clock runs fast by y counts :math:`t (1 + y)`, so that its TDOA grows by y per second beside the rate
of the geometry, :math:`\dot\tau = -f/f_c`, which FDOA measures if the tuning oscillators are good:

.. math:: \tau(t) + \int f/f_c\,dt = a + y\,t

is fitted by least squares. Where sampling and tuning are of one oscillator both change alike, and nothing is seen: it
looks like motion. Where nothing moves, the left side is TDOA alone, and y is seen whatever the oscillators do.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["ClockDrift", "clock_drift"]

Array = NDArray[np.float64]

_LEAST = 4  # times
_OUTLIER = 5.0  # robust standard deviations
_MAD = 1.4826


class ClockDrift(NamedTuple):
    """How fast a clock runs against another.

    Attributes
    ----------
    rate, sigma : float
        y, positive where the auxiliary receiver's clock is fast, and its standard deviation; with the scatter about the
        line, where that is larger than is believed of the measurements. NaN where there are fewer than four.
    """

    rate: float
    sigma: float

    def inflation(self, since: Array, sigma: Array) -> float:
        r"""Return by how much the sigmas of TDOA grow when :math:`y\,t` is taken away.

        The error of y is in all of them, so that their mean has the variance :math:`s^2/n + (\sigma_y \bar t)^2`;
        larger sigmas give the mean the same.

        Parameters
        ----------
        since : ndarray, shape (n,)
            Time since the clocks agreed [s].
        sigma : ndarray, shape (n,)
            Of each difference [s]; NaN where there is none.
        """
        there = np.isfinite(sigma)
        weight = 1 / np.square(sigma[there])
        if not weight.size:
            return 1.0
        middle = float((weight * since[there]).sum() / weight.sum())
        return math.sqrt(1 + (self.sigma * middle) ** 2 * float(weight.sum()))


def clock_drift(
    time: Array,
    tdoa: Array,
    sigma_tdoa: Array,
    fdoa: Array | None = None,
    sigma_fdoa: Array | None = None,
    carrier: float = 0.0,
) -> ClockDrift:
    """Return how fast the auxiliary receiver's sample clock runs.

    Parameters
    ----------
    time, tdoa, sigma_tdoa : ndarray, shape (n,)
        [s]; NaN where there is no difference.
    fdoa, sigma_fdoa : ndarray, shape (n,), optional
        [Hz]; without it the geometry does not change.
    carrier : float
        With `fdoa`: carrier frequency [Hz], > 0.
    """
    there = np.isfinite(tdoa) & np.isfinite(sigma_tdoa)
    rate, spread = np.zeros(time.size), np.zeros(time.size)
    if fdoa is not None and sigma_fdoa is not None:
        there &= np.isfinite(fdoa) & np.isfinite(sigma_fdoa)
        rate, spread = fdoa / carrier, sigma_fdoa / carrier
    keep = np.flatnonzero(there)
    for last in (False, True):
        if keep.size < _LEAST or np.ptp(time[keep]) == 0:
            return ClockDrift(math.nan, math.nan)
        slope, sigma, residual = _line(time[keep], tdoa[keep], sigma_tdoa[keep], rate[keep], spread[keep])
        if last:
            break
        robust = _MAD * float(np.median(np.abs(residual - np.median(residual))))
        keep = keep[np.abs(residual) <= _OUTLIER * max(robust, 1.0)]
    excess = float(np.square(residual).sum()) / (keep.size - 2)
    return ClockDrift(slope, sigma * math.sqrt(max(excess, 1.0)))


def _line(t: Array, tdoa: Array, sigma: Array, rate: Array, spread: Array) -> tuple[float, float, Array]:
    """Return the slope, its standard deviation, and the residuals in sigmas."""
    step = np.diff(t)
    integral = np.concatenate([[0.0], np.cumsum(0.5 * step * (rate[1:] + rate[:-1]))])
    value = tdoa + integral
    weight = 1 / np.square(sigma)
    middle = (weight * t).sum() / weight.sum()
    lever = weight * (t - middle) / (weight * np.square(t - middle)).sum()  # the slope is its product with the values
    slope = float(lever @ value)
    # a rate is in all values behind it: the sum of their levers, from each step on
    behind = np.cumsum(lever[::-1])[::-1]
    of_rate = np.zeros(t.size)
    of_rate[1:] += 0.5 * step * behind[1:]
    of_rate[:-1] += 0.5 * step * behind[1:]
    variance = float((np.square(lever) * np.square(sigma)).sum() + (np.square(of_rate) * np.square(spread)).sum())
    mean = (weight * value).sum() / weight.sum()
    return slope, math.sqrt(variance), (value - mean - slope * (t - middle)) / sigma
