"""Where the peak of a cross-ambiguity function is sought, and what is told of it."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Differences", "Flag", "Window"]

Array = NDArray[np.float64]


class Flag(enum.IntFlag):
    """Why an estimate is not to be believed."""

    GOOD = 0
    NO_SIGNAL = 1
    """Samples are all zero or not finite."""
    CLIPPED = 2
    """Too many samples at the largest value: the receiver was saturated."""
    NO_OVERLAP = 4
    """The auxiliary block does not hold what the main receiver's block is to be compared with."""
    BELOW_THRESHOLD = 8
    """Noise alone may well have made that peak."""
    EDGE = 16
    """The function rises beyond the edge of the window, or what was found is a side lobe: the window is too small."""
    LEFT_CELL = 32
    """The refinement did not stay near the coarse peak; the parabola's result stands."""


@dataclass(frozen=True)
class Window:
    """Where the peak is sought, per trial or the same for all.

    Parameters
    ----------
    delay, frequency : array_like, shape () or (trials,)
        Its centre [s], [Hz].
    half_delay, half_frequency : array_like, shape () or (trials,)
        Its half-widths [s], [Hz], >= 0.

    Raises
    ------
    ValueError
        If a centre is infinite or a half-width is negative or not finite. A centre that is NaN is allowed: there the
        result is NaN.
    """

    delay: ArrayLike
    frequency: ArrayLike
    half_delay: ArrayLike
    half_frequency: ArrayLike

    def __post_init__(self) -> None:
        """Check the arguments."""
        for name, unit in (("half_delay", "s"), ("half_frequency", "Hz")):
            value = np.asarray(getattr(self, name), dtype=float)
            if not np.all(np.isfinite(value) & (value >= 0)):
                raise ValueError(f"window {name}: {value} is not allowed; finite and >= 0 {unit}")
        for name in ("delay", "frequency"):
            if np.any(np.isinf(np.asarray(getattr(self, name), dtype=float))):
                raise ValueError(f"window {name}: it must not be infinite")

    @property
    def trials(self) -> int:
        """Number of windows."""
        sizes = [np.size(getattr(self, name)) for name in ("delay", "frequency", "half_delay", "half_frequency")]
        return max(sizes)

    def over(self, trials: int) -> tuple[Array, Array, Array, Array]:
        """Return the four, each of shape (trials,)."""
        values = (self.delay, self.frequency, self.half_delay, self.half_frequency)
        a, b, c, d = (np.broadcast_to(np.asarray(value, dtype=float), (trials,)) for value in values)
        return a, b, c, d


@dataclass(frozen=True)
class Differences:
    """What was found, over trials; NaN where there is nothing to be found.

    Attributes
    ----------
    delay, frequency : ndarray, shape (trials,)
        TDOA [s] and FDOA [Hz]; flagged ones are kept, see `flag`.
    time : ndarray, shape (trials,)
        What they hold for: the middle of the main receiver's block [s].
    variance : ndarray, shape (trials, 2)
        Predicted variances [s^2], [Hz^2], by the exact expression with the noise that the samples show.
    stein : ndarray, shape (trials, 2)
        The same by Stein's formulae.
    peak : ndarray, shape (trials,)
        Peak power over the mean noise power.
    confidence : ndarray, shape (trials,)
        Chance that noise alone stays below it, everywhere in the window.
    right_cell : ndarray, shape (trials,)
        Chance that a signal as strong as this one wins over the noise.
    coherence : ndarray, shape (trials,)
        Of the two channels behind the prefilter, 0 to 1.
    flag : ndarray of int, shape (trials,)
        Sum of `Flag`.
    """

    delay: Array
    frequency: Array
    time: Array
    variance: Array
    stein: Array
    peak: Array
    confidence: Array
    right_cell: Array
    coherence: Array
    flag: NDArray[np.int64]

    @property
    def good(self) -> NDArray[np.bool_]:
        """Where there is no flag, shape (trials,)."""
        return self.flag == Flag.GOOD

    @staticmethod
    def empty(trials: int) -> Differences:
        """Return NaN everywhere."""
        one = (np.full(trials, np.nan) for _ in range(7))
        delay, frequency, time, peak, sure, right, coherence = one
        two = np.full((trials, 2), np.nan), np.full((trials, 2), np.nan)
        return Differences(delay, frequency, time, *two, peak, sure, right, coherence, np.zeros(trials, dtype=np.int64))
