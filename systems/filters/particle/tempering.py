"""Progressive correction: a sharp likelihood taken in steps that the cloud survives."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.linear_algebra import dot

__all__ = ["conditional_share", "next_exponent"]

Array = NDArray[np.float64]

_SMALLEST = 25.0  # no step is smaller than e^-25 of what remains: such a likelihood is sharper than a double can be
_EVALUATIONS = 7  # leave the effective share within some percent above what is asked for


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
    scaled = log_likelihood - log_likelihood.max(axis=-1, keepdims=True)
    chosen = remaining.copy()
    whole = conditional_share(weight, scaled, remaining)
    short = np.flatnonzero(whole < share)
    if short.size == 0:
        return chosen
    if short.size < len(chosen):
        weight, scaled = weight[short], scaled[short]

    def surplus(logarithm: Array) -> Array:
        return np.log(conditional_share(weight, scaled, np.exp(logarithm)) / share)

    high, over_high = np.log(remaining[short]), np.log(whole[short] / share)
    low, over_low = high - _SMALLEST, np.full(short.size, -np.log(share))
    # For small exponents the share is exp(-exponent^2 variance); without -inf, which a particle may have.
    bounded = np.maximum(scaled, -1e12)
    mean = dot(weight, bounded)
    variance = dot(weight * bounded, bounded) - mean**2
    guess = 0.5 * np.log(-np.log(share) / np.maximum(variance, 1e-300))
    guess = np.clip(guess, low + 1.0, high - 0.1)
    for _ in range(_EVALUATIONS):
        over = surplus(guess)
        enough = over >= 0
        # Illinois: the end that stays counts half, so that both ends move
        over_high, over_low = np.where(enough, 0.5 * over_high, over), np.where(enough, over, 0.5 * over_low)
        low, high = np.where(enough, guess, low), np.where(enough, high, guess)
        guess = low + (high - low) * over_low / np.maximum(over_low - over_high, 1e-300)
    chosen[short] = np.exp(low)
    return chosen
