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

A channel that is quantised is, up to a gain, :math:`a s + n + d` with the distortion d of
`quietfix.systems.iq.bussgang`: its density D over the signal's power adds to :math:`\nu`. Where the noise dominates, D
is white, and one bit multiplies both sigmas by :math:`\sqrt{\pi/2} = 1.25`. As d belongs to s + n, its part in the
slope along the delay is smaller than that of an independent noise (without n the slope of :math:`\sum s\,Q(s)` is a
difference of two ends): with :math:`R'_d` the derivative of d's correlation by that of the channel, rho(t), all fourth
moments of Gaussian signals together give

.. math:: \int w^2 N W^2 \;\to\; \int w^2 N W^2 - \frac1{f_s}\sum_t a(t)^2 R_d'(\rho(t)),\qquad
          a(t) = \int j w W S e^{jwt} ,

while along the frequency I meets Q, and nothing is left out. If both channels are quantised the two distortions are
taken for independent, which they are where the noise dominates.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.systems.ambiguity.prefilter import Moments
from quietfix.systems.iq.bussgang import Quantiser

__all__ = ["Sigmas", "best", "effective_snr", "exact", "stein"]

Array = NDArray[np.float64]

Quantisers = tuple[Quantiser | None, Quantiser | None]

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


def exact(
    moments: Moments,
    sample_rate: float,
    duration: float,
    first: ArrayLike,
    second: ArrayLike,
    quantisers: Quantisers = (None, None),
) -> Sigmas:
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
    quantisers : pair of Quantiser or None
        What the samples of the two channels have passed.

    Raises
    ------
    ValueError
        If the spectrum is not known.
    """
    return _sigmas(moments, sample_rate, duration, (first, second), quantisers, optimal=False)


def best(
    moments: Moments,
    sample_rate: float,
    duration: float,
    first: ArrayLike,
    second: ArrayLike,
    quantisers: Quantisers = (None, None),
) -> Sigmas:
    """Return the bound, attained by maximum likelihood; arguments as in `exact`, whose filter is not used.

    With quantisers it is what the best weight of the quantised samples' cross-spectrum attains.
    """
    return _sigmas(moments, sample_rate, duration, (first, second), quantisers, optimal=True)


class _Distorted(NamedTuple):
    """What a quantiser adds: density over the signal's power [1/Hz], shape (..., n); rho and R_d' at the lags."""

    density: Array
    slope: Array


def _distorted(quantiser: Quantiser, moments: Moments, sample_rate: float, snr: Array) -> _Distorted:
    assert moments.spectrum is not None
    size = moments.frequency.size
    of_signal = np.fft.ifft(np.fft.ifftshift(moments.spectrum)).real * size * moments.step
    rho = snr / (1 + snr) * of_signal
    rho[..., 0] = 1.0
    density = np.fft.fftshift(np.fft.fft(quantiser.correlation(rho), axis=-1).real, axes=-1)
    rho[..., 0] = 0.0  # where a(0) = 0 anyway
    return _Distorted(np.maximum(density, 0.0) * (1 + 1 / snr) / sample_rate, quantiser.slope(rho))


def _sigmas(
    moments: Moments,
    sample_rate: float,
    duration: float,
    snrs: tuple[ArrayLike, ArrayLike],
    quantisers: Quantisers,
    optimal: bool,
) -> Sigmas:
    if moments.spectrum is None:
        raise ValueError("variance: the prefilter does not know the signal's spectrum; give one that does")
    ratios = [np.asarray(g, dtype=float)[..., None] for g in snrs]
    added = [
        None if quantiser is None else _distorted(quantiser, moments, sample_rate, g)
        for quantiser, g in zip(quantisers, ratios, strict=True)
    ]
    nu1, nu2 = (
        1 / (g * sample_rate) + (0.0 if more is None else more.density) for g, more in zip(ratios, added, strict=True)
    )
    s = moments.spectrum
    noise = s * (nu1 + nu2) + nu1 * nu2
    weight = s / noise if optimal else moments.weight
    product = s * weight
    w = 2 * np.pi * moments.frequency
    w = w - (w * product).sum(axis=-1, keepdims=True) / product.sum(axis=-1, keepdims=True)

    sent = np.fft.ifftshift(w * product, axes=-1)
    own = np.square(np.fft.ifft(sent, axis=-1).imag * w.shape[-1] * moments.step)
    spared = sum((own * more.slope).sum(axis=-1) / sample_rate for more in added if more is not None)

    def variance(lever: Array | float, less: Array | float) -> Array:
        spread = (lever * noise * np.square(weight)).sum(axis=-1) * moments.step - less
        return spread / (2 * duration * np.square((lever * product).sum(axis=-1) * moments.step))

    te = _TIME_SPREAD * duration
    return Sigmas(np.sqrt(variance(np.square(w), spared)), np.sqrt(variance(1.0, 0.0)) / te)
