"""Samples at other times: band-limited interpolation by a windowed sinc."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.iq.block import IqBlock

__all__ = ["interpolate", "resampled"]

Array = NDArray[np.float64]

_HALF = 24  # samples on either side
_BETA = 9.0  # Kaiser window: -90 dB up to 0.44 of the sample rate on both sides of the centre
_AT_ONCE = 1 << 14
_PHASES = 4096  # between two samples; linear between them, which is good to 1e-7


@cache
def _kernels() -> Array:
    """Return the windowed sinc of every phase at the samples around, shape (phases + 1, 2 half)."""
    away = np.arange(_PHASES + 1)[:, None] / _PHASES - np.arange(1 - _HALF, _HALF + 1)
    inner = np.maximum(1 - np.square(away / _HALF), 0.0)
    return np.sinc(away) * np.i0(_BETA * np.sqrt(inner)) / np.i0(_BETA)


def interpolate(samples: NDArray[np.complexfloating], place: Array) -> NDArray[np.complex128]:
    """Return a sampled signal between its samples.

    Parameters
    ----------
    samples : ndarray of complex, shape (..., n)
        The signal; zero beyond both ends.
    place : ndarray, shape (k,)
        Where it is wanted, in samples from the first one.

    Returns
    -------
    ndarray of complex, shape (..., k)

    Notes
    -----
    For a lower sample rate nothing is filtered out: what does not fit there has to be gone before.
    """
    padded = np.pad(samples, [(0, 0)] * (samples.ndim - 1) + [(2 * _HALF, 2 * _HALF)])
    out = np.empty((*samples.shape[:-1], place.size), dtype=complex)
    taps, kernels = np.arange(1 - _HALF, _HALF + 1), _kernels()
    for begin in range(0, place.size, _AT_ONCE):
        part = place[begin : begin + _AT_ONCE]
        whole = np.floor(part)
        phase = (part - whole) * _PHASES
        lower = phase.astype(np.int64)
        share = (phase - lower)[:, None]
        kernel = (1 - share) * kernels[lower] + share * kernels[lower + 1]
        near = np.clip(whole, -_HALF - 1, samples.shape[-1] + _HALF - 1).astype(np.int64) + 2 * _HALF
        out[..., begin : begin + part.size] = np.einsum("...kt,kt->...k", padded[..., near[:, None] + taps], kernel)
    return out


def resampled(block: IqBlock, sample_rate: float) -> IqBlock:
    """Return a block at another sample rate, from the same first sample on."""
    count = int(np.floor((block.size - 1) * sample_rate / block.sample_rate)) + 1
    place: Array = np.arange(count, dtype=np.float64) * (block.sample_rate / sample_rate)
    return IqBlock(interpolate(block.samples, place), sample_rate, block.centre_frequency, block.start_time)
