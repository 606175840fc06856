"""A block of complex baseband samples, of one receiver, in all trials."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["IqBlock"]


@dataclass(frozen=True, eq=False)
class IqBlock:
    """Samples with what is needed to know what they mean.

    Nobody can write into it, and a copy of it is itself: so it travels through abstract ports, whose values Drake
    clones with every context, at no cost.

    Parameters
    ----------
    samples : array_like of complex, shape (trials, samples)
        Complex envelope at `centre_frequency`. NaN in a trial means that nothing was received in it.
    sample_rate : float
        [Hz], > 0.
    centre_frequency : float
        Frequency of the receiver's oscillator [Hz], >= 0; 0 for signals that were never mixed down.
    start_time : array_like, shape (trials,) or ()
        Time of the first sample at the receiver [s].

    Raises
    ------
    ValueError
        If a shape or a number is not allowed.
    """

    samples: NDArray[np.complexfloating]
    sample_rate: float
    centre_frequency: float
    start_time: NDArray[np.float64]

    def __init__(
        self, samples: ArrayLike, sample_rate: float, centre_frequency: float, start_time: ArrayLike = 0.0
    ) -> None:
        array = np.array(samples)
        if not np.iscomplexobj(array):
            raise ValueError(f"samples: {array.dtype} is not allowed; complex numbers")
        array = np.atleast_2d(array)
        if array.ndim != 2 or array.shape[1] == 0:
            raise ValueError(f"samples: shape {array.shape} is not allowed; (trials, samples), at least one sample")
        if not (math.isfinite(sample_rate) and sample_rate > 0):
            raise ValueError(f"sample_rate: {sample_rate} is not allowed; a finite number > 0 Hz")
        if not (math.isfinite(centre_frequency) and centre_frequency >= 0):
            raise ValueError(f"centre_frequency: {centre_frequency} is not allowed; a finite number >= 0 Hz")
        times = np.array(start_time, dtype=float)
        if times.shape not in ((), (1,), (array.shape[0],)):
            raise ValueError(f"start_time: shape {times.shape} is not allowed; one, or one for each of the trials")
        if not np.all(np.isfinite(times)):
            raise ValueError("start_time: all must be finite")
        times = np.array(np.broadcast_to(times, array.shape[:1]))
        for value in (array, times):
            value.setflags(write=False)
        object.__setattr__(self, "samples", array)
        object.__setattr__(self, "sample_rate", float(sample_rate))
        object.__setattr__(self, "centre_frequency", float(centre_frequency))
        object.__setattr__(self, "start_time", times)

    def __deepcopy__(self, memo: dict[int, Any]) -> IqBlock:
        return self

    @property
    def trials(self) -> int:
        """Number of trials."""
        return self.samples.shape[0]

    @property
    def size(self) -> int:
        """Samples per trial."""
        return self.samples.shape[1]

    @property
    def duration(self) -> float:
        """Samples divided by the sample rate [s]."""
        return self.size / self.sample_rate

    @property
    def mid_time(self) -> NDArray[np.float64]:
        """Time halfway between the first and the last sample [s], shape (trials,): what TDOA and FDOA hold for."""
        return self.start_time + 0.5 * (self.size - 1) / self.sample_rate
