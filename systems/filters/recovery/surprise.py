r"""A running test of whether innovations go on to be larger than they are said to be.

The normalised innovation squared q over d rows is :math:`\chi^2_d` where a filter is right. Against the alternative
that it is :math:`\lambda\,\chi^2_d` (errors :math:`\sqrt\lambda` times as large as said), the logarithm of the
likelihood ratio is

.. math:: \ell = \tfrac12 (1 - 1/\lambda)\,q - \tfrac12\,d \ln\lambda .

Its cumulative sum, held at zero from below, is the test of Page (*Continuous inspection schemes*, Biometrika 41 (1954)
100): the largest sum over all epochs since some earlier one. Whatever that one is, the ratio is a martingale of mean 1
where the filter is right, so that it ever exceeds :math:`e^h` with a probability below :math:`e^{-h}` (Ville's
inequality), and with N epochs to begin at, an alarm in a run of N epochs has a probability below :math:`N e^{-h}`.
With :math:`h = \ln(10^4/10^{-3})` that is one false alarm in a thousand runs of ten thousand epochs, at most.

No epoch counts for more than h/10, which makes the sum only smaller: more than ten epochs out of band raise the alarm,
and gross errors now and then do not. The sum grows in the mean where
:math:`E q/d > \ln\lambda / (1 - 1/\lambda)`, 1.85 for the lambda here, 4. It is held at 2 h from above, so that an
alarm goes out again when the filter has come back.

Biases that are considered stay in the innovations: these are as large as said over all trials, but in one trial all
alike. Of n biases b in units of their sigmas, :math:`|b|^2` is below :math:`c = \chi^2_n` at :math:`10^{-3}`,
so what they put into the innovation is a vector m with :math:`m^T S^{-1} m \le c`. Given b, q/c in place of q has then
:math:`E e^\ell \le (1 - a/c)^{-d/2} e^{a / (2 (1 - a/c))} 2^{-d}`, a = 3/4, less than 1 for every c and d there are;
false alarms are at most one in a thousand runs more (that a Schmidt filter's gain leaves the rest a little correlated
is not counted). What is noticed is larger by the root of c, 3.3 for one bias, 4.3 for four.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from quietfix.systems.kernels.recovery.calls import follow

__all__ = ["ALARM", "RULE", "lasting", "surprise"]

Array = NDArray[np.float64]

_LAMBDA = 4.0
_EPOCHS, _FALSE_ALARMS = 1e4, 1e-3

ALARM = math.log(_EPOCHS / _FALSE_ALARMS)
"""h: a sum above this says that the filter is lost."""

RULE = (0.5 * (1 - 1 / _LAMBDA), 0.5 * math.log(_LAMBDA), ALARM / 10, 2 * ALARM)
"""What a NIS and a row count, how much an epoch counts at most, and what the sum is at most."""


def lasting(biases: int) -> float:
    """Return by what a NIS is divided in which so many considered biases (0: none) are the same at every epoch."""
    return float(chi2.isf(_FALSE_ALARMS, biases)) if biases else 1.0


def surprise(nis: Array, rows: Array, total: Array) -> None:
    """Add, in place, to the sum (trials,) what an epoch says.

    Parameters
    ----------
    nis, rows : ndarray of float, shape (trials,)
        Normalised innovation squared and its degrees of freedom; a trial with 0 rows stays as it is.
    total : ndarray, shape (trials,)
        Contiguous; begins at 0.
    """
    follow(nis, rows, RULE, total)
