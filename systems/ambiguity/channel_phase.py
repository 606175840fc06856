r"""Phase between two channels that were sampled together.

With the cross-spectrum :math:`C_k = \bar X_k Y_k` behind the prefilter, :math:`\phi = \arg\sum_k C_k`, and to first
order in the noise its error is the sum of the parts in quadrature over that in phase: bins of white noise are
independent, so that

.. math:: \sigma_\phi^2 = \sum_k [\Im(C_k e^{-j\phi})]^2 \Big/ \Big[\sum_k \Re(C_k e^{-j\phi})\Big]^2 ,

which is :math:`(1 - \gamma^2)/(2 n \gamma^2)` for n bins of coherence :math:`\gamma`. A delay between the channels must
be short against one over the bandwidth.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from quietfix.systems.ambiguity.prefilter import Prefilter
from quietfix.systems.iq.block import IqBlock

__all__ = ["channel_phase"]

Array = NDArray[np.float64]


def channel_phase(first: IqBlock, second: IqBlock, prefilter: Prefilter) -> Array:
    """Return the phase of the second channel minus that of the first, -pi to pi, and its standard deviation [rad].

    Parameters
    ----------
    first, second : IqBlock
        Of equal times.
    prefilter : Prefilter
        What both pass.

    Returns
    -------
    ndarray, shape (trials, 2)
        NaN where samples are missing or all zero.

    Raises
    ------
    ValueError
        If they are not of one size and rate.
    """
    if (first.size, first.sample_rate) != (second.size, second.sample_rate):
        raise ValueError(
            f"second: {second.size} samples at {second.sample_rate} Hz are not allowed; {first.size} at "
            f"{first.sample_rate} Hz as the first channel's"
        )
    weight = prefilter.table(first.size, first.sample_rate)
    x, y = (fft.fft(block.samples, axis=-1) * weight for block in (first, second))
    cross = np.conjugate(x) * y
    total = cross.sum(axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        size = np.abs(total)
        turned = cross * (np.conjugate(total) / size)[:, None]
        sigma = np.sqrt(np.square(turned.imag).sum(axis=-1)) / size
    return np.stack([np.where(size > 0, np.angle(total), np.nan), sigma], axis=-1)
