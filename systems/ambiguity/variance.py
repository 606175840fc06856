r"""How good a TDOA and an FDOA from the cross-ambiguity function can be.

Two channels hold :math:`a_i s + n_i`; S is the signal's power spectrum of unit area [1/Hz],
:math:`\nu_i = n_i/a_i^2` the white noise density over the signal's power [1/Hz] and W = |G|^2 the weight of the
prefilters. To first order in the noise the peak of |A| lies at the truth with

.. math:: \sigma_\tau^2 = \frac{\int w^2 N W^2}{2T (\int w^2 S W)^2},\qquad
          \sigma_f^2 = \frac{\int N W^2}{2T T_e^2 (\int S W)^2},\qquad
          N = S(\nu_1 + \nu_2) + \nu_1\nu_2,\quad T_e = \pi T/\sqrt 3 ,

integrals over frequency [Hz] and w = 2 pi f from the centre of S W: the slope of log|A| is the part of the weighted
cross-spectrum in quadrature, each of whose bins has half of the variance N W^2 T, and the curvature is in the
denominator.
For W = 1 that is the plain function; :math:`W = S/N` minimises it, which gives the bound. Stein (*Algorithms for
ambiguity function processing*, IEEE Trans. ASSP-29 (1981) 588) has :math:`\sigma_\tau = 1/(\beta\sqrt{B T\gamma})`,
:math:`\sigma_f = 1/(T_e\sqrt{B T\gamma})`, which counts noise inside B as if it were shaped like the signal and none
outside.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from systems.ambiguity.prefilter import Moments

__all__ = ["Sigmas", "best", "effective_snr", "exact", "stein"]

Array = NDArray[np.float64]

_TIME_SPREAD = math.pi / math.sqrt(3.0)  # T_e / T: 2 pi times the standard deviation of a uniform time


class Sigmas(NamedTuple):
    """Standard deviations of TDOA [s] and FDOA [Hz], shape (...)."""

    delay: Array
    frequency: Array


def effective_snr(first: ArrayLike, second: ArrayLike) -> Array:
    r"""Return Stein's :math:`\gamma = 2 g_1 g_2/(1 + g_1 + g_2)` of two SNRs (ratios of powers)."""
    g1, g2 = np.asarray(first, dtype=float), np.asarray(second, dtype=float)
    return 2 * g1 * g2 / (1 + g1 + g2)


def stein(time_bandwidth: ArrayLike, gamma: ArrayLike, bandwidth_rms: float, duration: float) -> Sigmas:
    r"""Return Stein's formulae.

    Parameters
    ----------
    time_bandwidth : array_like, shape (...)
        B T, with B the noise bandwidth in which the SNRs hold.
    gamma : array_like, shape (...)
        See `effective_snr`.
    bandwidth_rms : float
        :math:`\beta`, root mean square of the signal's angular frequency [rad/s].
    duration : float
        T [s].
    """
    root = np.sqrt(np.asarray(time_bandwidth, dtype=float) * np.asarray(gamma, dtype=float))
    return Sigmas(1 / (bandwidth_rms * root), 1 / (_TIME_SPREAD * duration * root))


def exact(moments: Moments, sample_rate: float, duration: float, first: ArrayLike, second: ArrayLike) -> Sigmas:
    """Return what the function with a prefilter attains.

    Parameters
    ----------
    moments : Moments
        Of the prefilter, which must know the signal's spectrum.
    sample_rate : float
        [Hz].
    duration : float
        T [s].
    first, second : array_like, shape (...)
        SNR of the two channels: signal power over the noise power in the whole of `sample_rate`.

    Raises
    ------
    ValueError
        If the spectrum is not known.
    """
    return _sigmas(moments, sample_rate, duration, first, second, optimal=False)


def best(moments: Moments, sample_rate: float, duration: float, first: ArrayLike, second: ArrayLike) -> Sigmas:
    """Return the bound, attained by maximum likelihood; arguments as in `exact`, whose filter is not used."""
    return _sigmas(moments, sample_rate, duration, first, second, optimal=True)


def _sigmas(
    moments: Moments, sample_rate: float, duration: float, first: ArrayLike, second: ArrayLike, optimal: bool
) -> Sigmas:
    if moments.spectrum is None:
        raise ValueError("variance: the prefilter does not know the signal's spectrum; give one that does")
    nu1, nu2 = (1 / (np.asarray(g, dtype=float)[..., None] * sample_rate) for g in (first, second))
    s = moments.spectrum
    noise = s * (nu1 + nu2) + nu1 * nu2
    weight = s / noise if optimal else moments.weight
    product = s * weight
    w = 2 * np.pi * moments.frequency
    w = w - (w * product).sum(axis=-1, keepdims=True) / product.sum(axis=-1, keepdims=True)

    def variance(lever: Array | float) -> Array:
        spread = (lever * noise * np.square(weight)).sum(axis=-1)
        return spread / (2 * duration * np.square((lever * product).sum(axis=-1)) * moments.step)

    te = _TIME_SPREAD * duration
    return Sigmas(np.sqrt(variance(np.square(w))), np.sqrt(variance(1.0)) / te)
