"""Progressive correction: a sharp likelihood taken in steps that the cloud survives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.particles.staging import Shares, exponents
from quietfix.systems.linear_algebra import dot

__all__ = ["conditional_share", "next_exponent"]

Array = NDArray[np.float64]


def conditional_share(weight: Array, log_likelihood: Array, exponent: Array) -> Array:
    r"""Return the conditional effective sample size over N of likelihood^exponent, shape (trials,).

    .. math:: \frac{\left(\sum_i w_i v_i\right)^2}{\sum_i w_i v_i^2}, \qquad v_i = \ell_i^\delta

    It is the effective sample size where the weights are equal, and falls as the exponent grows. Zhou, Johansen and
    Aston, *Toward automatic model comparison: an adaptive sequential Monte Carlo approach*, J. Computational and
    Graphical Statistics 25 (2016) 701-726, eq. (3.16).

    Parameters
    ----------
    weight : ndarray, shape (trials, N)
        They sum to 1.
    log_likelihood : ndarray, shape (trials, N)
        Largest value 0.
    exponent : ndarray, shape (trials,)
    """
    value = np.exp(exponent[:, None] * log_likelihood)
    weighted = weight * value
    return weighted.sum(axis=-1) ** 2 / dot(weighted, value)


def next_exponent(weight: Array, log_likelihood: Array, remaining: Array, share: float) -> Array:
    """Return the largest exponent that keeps an effective share of the particles, at most what remains.

    A bracketed search on the logarithm of the exponent (false position with the Illinois rule), in every trial that
    cannot take all at once; plain bisection needs twice the evaluations. Musso, Oudjane and Le Gland, *Improving
    regularised particle filters*, in Doucet et al., *Sequential Monte Carlo Methods in Practice*, 2001, 247-271
    (progressive correction).

    Parameters
    ----------
    weight : ndarray, shape (trials, N)
        They sum to 1.
    log_likelihood : ndarray, shape (trials, N)
        At least one of each trial finite.
    remaining : ndarray, shape (trials,)
        > 0.
    share : float
        Between 0 and 1.

    Returns
    -------
    ndarray, shape (trials,)
        Exactly `remaining` where that keeps the share.
    """
    shares = Shares(weight, np.zeros(len(weight), dtype=bool), np.zeros(len(weight)))
    return exponents(log_likelihood, log_likelihood.max(axis=-1), shares, remaining, share)
