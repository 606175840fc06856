"""Samples at other times: band-limited interpolation by a windowed sinc, for each output the phase that it needs."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.iq.block import IqBlock

__all__ = ["interpolate", "resampled"]

Array = NDArray[np.float64]

_HALF = 24  # samples of the lower of the two rates on either side
_BETA = 9.0  # Kaiser window: -90 dB up to 0.44 of the lower sample rate on both sides of the centre, and beyond 0.56
_AT_ONCE = 48 << 14  # products
_PHASES = 4096  # between two samples of the lower rate; linear between them, which is good to 1e-7
_NARROWEST = 1e-4


@lru_cache(maxsize=4)
def _kernels(half: int, cutoff: float) -> Array:
    """Return the windowed sinc of every phase at the samples around, shape (phases + 1, 2 half)."""
    phases = max(math.ceil(_PHASES * cutoff), 1)
    away = cutoff * (np.arange(phases + 1)[:, None] / phases - np.arange(1 - half, half + 1))
    inner = np.maximum(1 - np.square(away / _HALF), 0.0)
    return cutoff * np.sinc(away) * np.i0(_BETA * np.sqrt(inner)) * (np.abs(away) <= _HALF) / np.i0(_BETA)


def interpolate(samples: NDArray[np.complexfloating], place: Array, cutoff: float = 1.0) -> NDArray[np.complex128]:
    """Return a sampled signal between its samples.

    Parameters
    ----------
    samples : ndarray of complex, shape (..., n)
        The signal; zero beyond both ends.
    place : ndarray, shape (k,)
        Where it is wanted, in samples from the first one.
    cutoff : float
        What is let through, as a share of the sample rate: that at which `place` goes on, where it is lower. 1: all.

    Returns
    -------
    ndarray of complex, shape (..., k)

    Notes
    -----
    With a cutoff c below 1 a ripple of 3e-5 stands up to 0.44 c of the sample rate on both sides of the centre, and
    what lies beyond 0.56 c is 90 dB down; what is between folds onto 0.44 c to 0.5 c.

    Raises
    ------
    ValueError
        For a cutoff that is not 1e-4 to 1.
    """
    if not _NARROWEST <= cutoff <= 1:
        raise ValueError(f"cutoff: {cutoff:g} is not allowed; {_NARROWEST:g} to 1")
    half = math.ceil(_HALF / cutoff)
    padded = np.pad(samples, [(0, 0)] * (samples.ndim - 1) + [(2 * half, 2 * half)])
    out = np.empty((*samples.shape[:-1], place.size), dtype=complex)
    taps, kernels = np.arange(1 - half, half + 1), _kernels(half, cutoff)
    phases, step = kernels.shape[0] - 1, max(_AT_ONCE // (2 * half), 1)
    for begin in range(0, place.size, step):
        part = place[begin : begin + step]
        whole = np.floor(part)
        phase = (part - whole) * phases
        lower = phase.astype(np.int64)
        share = (phase - lower)[:, None]
        kernel = (1 - share) * kernels[lower] + share * kernels[lower + 1]
        near = np.clip(whole, -half - 1, samples.shape[-1] + half - 1).astype(np.int64) + 2 * half
        out[..., begin : begin + part.size] = np.einsum("...kt,kt->...k", padded[..., near[:, None] + taps], kernel)
    return out


def resampled(block: IqBlock, sample_rate: float) -> IqBlock:
    """Return a block at another sample rate, from the same first sample on; what does not fit there is filtered out."""
    ratio = sample_rate / block.sample_rate
    count = int(np.floor((block.size - 1) * ratio)) + 1
    place: Array = np.arange(count, dtype=np.float64) * (block.sample_rate / sample_rate)
    samples = interpolate(block.samples, place, min(ratio, 1.0))
    return IqBlock(samples, sample_rate, block.centre_frequency, block.start_time)
