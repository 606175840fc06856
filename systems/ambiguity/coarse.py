r"""Coarse search: the cross-ambiguity function on a grid of delays and frequencies, by blocks.

The first channel is cut into blocks of L samples. In each, the Fourier transform correlates it with the second channel
at all delays of the window at once; over the blocks a second transform turns the correlations at each delay into
frequencies. Within a block a frequency difference f is not followed, which costs sinc(f L / fs): 0.9 dB at a quarter
of a cycle, so L is the power of two below that.

Stein, *Algorithms for ambiguity function processing*, IEEE Trans. ASSP-29 (1981) 588.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import fft

__all__ = ["CoarseGrid", "ambiguity_grid", "plan"]

Complex = NDArray[np.complex64]

_CYCLES = 0.25  # of the largest frequency in a block
_LEAST_BLOCKS = 16
_PADDING = 2  # grid points per 1/T


@dataclass(frozen=True)
class CoarseGrid:
    """Which delays and frequencies are computed.

    Attributes
    ----------
    block : int
        L [samples].
    blocks : int
        How many of them hold the first channel, the last one filled with zeros.
    lags : int
        Delays from -lags to lags [samples].
    bins : int
        Frequencies from -bins to bins, in steps of `step`.
    transform : int
        Length of the transform over the blocks.
    """

    block: int
    blocks: int
    lags: int
    bins: int
    transform: int

    @property
    def step(self) -> float:
        """Step of the frequencies [cycles per sample]."""
        return 1 / (self.block * self.transform)


def plan(samples: int, lags: int, half_frequency: float, more: float) -> CoarseGrid:
    """Return the grid for a window.

    Parameters
    ----------
    samples : int
        Of the first channel.
    lags : int
        Largest delay [samples].
    half_frequency : float
        Largest frequency of the window [cycles per sample].
    more : float
        How many 1/T beyond that are computed as well.
    """
    largest = max(samples // _LEAST_BLOCKS, 1)
    if half_frequency > 0:
        largest = min(largest, max(int(_CYCLES / half_frequency), 1))
    block = 1 << (largest.bit_length() - 1)
    blocks = -(-samples // block)
    transform = fft.next_fast_len(_PADDING * blocks)
    wanted = math.ceil((half_frequency + more / samples) * block * transform)
    return CoarseGrid(block, blocks, lags, min(wanted, (transform - 1) // 2), transform)


def ambiguity_grid(first: Complex, second: Complex, grid: CoarseGrid) -> NDArray[np.float32]:
    """Return |A|^2 on the grid.

    Parameters
    ----------
    first : ndarray, shape (trials, n)
        Main channel.
    second : ndarray, shape (trials, n + 2 lags)
        Auxiliary channel, from `lags` samples before to as many after.
    grid : CoarseGrid
        What `plan` returned.

    Returns
    -------
    ndarray, shape (trials, 2 lags + 1, 2 bins + 1)
    """
    trials, size = first.shape
    length, blocks, lags = grid.block, grid.blocks, grid.lags
    missing = blocks * length - size
    if missing:
        first = np.pad(first, ((0, 0), (0, missing)))
        second = np.pad(second, ((0, 0), (0, missing)))
    points = fft.next_fast_len(length + 2 * lags, real=True)
    x = fft.fft(first.reshape(trials, blocks, length), points, axis=-1)
    windows = sliding_window_view(second, length + 2 * lags, axis=-1)[:, ::length]
    y = fft.fft(windows, points, axis=-1)
    np.conjugate(x, out=x)
    x *= y
    correlation = fft.ifft(x, axis=-1, overwrite_x=True)[..., : 2 * lags + 1]
    spectrum = fft.fft(np.ascontiguousarray(np.swapaxes(correlation, 1, 2)), grid.transform, axis=-1)
    spectrum = np.concatenate([spectrum[..., -grid.bins :], spectrum[..., : grid.bins + 1]], axis=-1)
    return np.square(spectrum.real) + np.square(spectrum.imag)
