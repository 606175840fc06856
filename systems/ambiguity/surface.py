"""The cross-ambiguity function on a fine grid, exactly: for pictures."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from quietfix.systems.ambiguity.differences import Window
from quietfix.systems.ambiguity.prefilter import Everything, Prefilter
from quietfix.systems.iq.block import IqBlock

__all__ = ["Surface", "ambiguity_surface"]

Array = NDArray[np.float64]

_SUBBLOCKS = 1024


class Surface(NamedTuple):
    """The function over a window.

    Attributes
    ----------
    delay, frequency : ndarray, shape (n,), (m,)
        Grid [s], [Hz].
    magnitude : ndarray, shape (n, m)
        Of A over the geometric mean of the energies behind the prefilter: 1 for equal signals without noise.
    """

    delay: Array
    frequency: Array
    magnitude: Array


def ambiguity_surface(
    main: IqBlock,
    auxiliary: IqBlock,
    window: Window,
    prefilter: Prefilter | None = None,
    points: tuple[int, int] = (121, 121),
    trial: int = 0,
) -> Surface:
    """Return the function on a grid of delays and frequencies.

    Parameters
    ----------
    main, auxiliary : IqBlock
        What the receivers heard, at one sample rate.
    window : Window
        What is shown.
    prefilter : Prefilter, optional
        What both channels pass; default: all.
    points : (int, int)
        Of the grid, along delay and frequency.
    trial : int
        Which trial.

    Raises
    ------
    ValueError
        If the sample rates differ.
    """
    rate = main.sample_rate
    if auxiliary.sample_rate != rate:
        raise ValueError(f"auxiliary sample_rate: {auxiliary.sample_rate} Hz is not allowed; {rate} Hz")
    centre, offset, half_delay, half_frequency = (value[0] for value in window.over(1))
    delay = centre + np.linspace(-half_delay, half_delay, points[0])
    frequency = offset + np.linspace(-half_frequency, half_frequency, points[1])
    x = main.samples[trial % main.trials]
    y = auxiliary.samples[trial % auxiliary.trials]
    size = fft.next_fast_len(x.size + y.size)
    response = (prefilter or Everything()).table(size, rate)
    # the middle of the frequencies goes first, so that both signals pass the filter alike
    tuned = auxiliary.centre_frequency - main.centre_frequency
    t = np.arange(y.size) / rate
    spectrum = fft.fft(y * np.exp(-2j * np.pi * (offset - tuned) * t), size) * response
    x = fft.ifft(fft.fft(x, size) * response)[: x.size]
    lead = float(main.start_time[trial % main.trials] - auxiliary.start_time[trial % auxiliary.trials])
    length = -(-x.size // _SUBBLOCKS)
    edges = np.arange(0, x.size, length)
    middle = (edges + 0.5 * np.minimum(length, x.size - edges)) / rate
    turn = np.exp(-2j * np.pi * (frequency - offset)[:, None] * middle)
    w = 2j * np.pi * fft.fftfreq(size, 1 / rate)
    energy = np.square(np.abs(x)).sum()
    out = np.empty((points[0], points[1]))
    for k, tau in enumerate(delay):
        shifted = fft.ifft(spectrum * np.exp(w * (tau + lead)))[: x.size]
        sums = np.add.reduceat(np.conjugate(x) * shifted, edges)
        out[k] = np.abs(turn @ sums) / np.sqrt(energy * np.square(np.abs(shifted)).sum())
    return Surface(delay, frequency, out)
