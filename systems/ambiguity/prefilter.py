r"""Prefilters: what both channels pass before they are correlated.

White noise outside the signal's band counts in the variance of the delay with the square of its frequency, so a filter
matched to the signal is worth a factor of two at low SNR. With :math:`W = |G|^2` the cross-spectrum is weighted by W;
for :math:`W \propto S`, the signal's own spectrum, that is the maximum-likelihood weight where noise dominates
(Knapp and Carter, *The generalized correlation method for estimation of time delay*, IEEE Trans. ASSP-24 (1976) 320).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import fft

__all__ = ["Band", "Everything", "Matched", "Moments", "Prefilter", "RootRaisedCosine", "Shaped"]

Array = NDArray[np.float64]

_GRID = 4096  # points of the spectral integrals; the functions are smooth but for two edges


class Prefilter:
    """A real frequency response G, and the spectrum of the signal it is meant for.

    Subclasses are frozen dataclasses: equal ones share their tables.

    Attributes
    ----------
    edges : tuple of float or None
        Band outside which G is zero [Hz from the centre frequency]; None: there is none.
    """

    edges: tuple[float, float] | None = None

    def response(self, frequency: ArrayLike) -> Array:
        """Return G at frequencies [Hz], shape (...); at most about 1, for numbers of ordinary size."""
        raise NotImplementedError

    def spectrum(self, frequency: ArrayLike) -> Array | None:
        """Return the signal's power spectrum in any unit, shape (...), or None where it is not known."""
        return None

    def moments(self, sample_rate: float) -> Moments:
        """Return the spectral integrals that variances need."""
        return _moments(self, sample_rate)

    def table(self, size: int, sample_rate: float) -> NDArray[np.float32]:
        """Return G at the frequencies of a discrete Fourier transform of `size` samples, shape (size,)."""
        return _table(self, size, sample_rate)


@dataclass(frozen=True)
class Everything(Prefilter):
    """No filter: G = 1."""

    def response(self, frequency: ArrayLike) -> Array:
        """See `Prefilter.response`."""
        return np.ones_like(np.asarray(frequency, dtype=float))


@dataclass(frozen=True)
class Band(Prefilter):
    """A rectangular band, for a signal that fills it evenly.

    Parameters
    ----------
    low, high : float
        Edges [Hz from the centre frequency], low < high.
    notch : float
        Half-width of a gap about the centre frequency [Hz]: takes away a carrier; 0: none.
    known : bool
        Whether the signal's spectrum is taken to be the band; False: it is not known, and what variances need of it
        is measured.
    """

    low: float
    high: float
    notch: float = 0.0
    known: bool = True

    def __post_init__(self) -> None:
        """Check the arguments."""
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low < self.high):
            raise ValueError(f"prefilter band: {self.low} to {self.high} Hz is not allowed; low < high")
        if not 0 <= self.notch < max(-self.low, self.high):
            raise ValueError(f"prefilter notch: {self.notch} Hz is not allowed; 0 or more, and narrower than the band")

    @property
    def edges(self) -> tuple[float, float]:  # type: ignore[override]
        """See `Prefilter`."""
        return self.low, self.high

    def response(self, frequency: ArrayLike) -> Array:
        """See `Prefilter.response`."""
        f = np.asarray(frequency, dtype=float)
        return ((f >= self.low) & (f <= self.high) & (np.abs(f) >= self.notch)).astype(float)

    def spectrum(self, frequency: ArrayLike) -> Array | None:
        """See `Prefilter.spectrum`."""
        return self.response(frequency) if self.known else None


@dataclass(frozen=True)
class RootRaisedCosine(Prefilter):
    """The filter matched to root-raised-cosine pulses; the signal's spectrum is its square.

    Parameters
    ----------
    symbol_rate : float
        [Hz], > 0.
    roll_off : float
        0 < roll_off <= 1.
    """

    symbol_rate: float
    roll_off: float

    def __post_init__(self) -> None:
        """Check the arguments."""
        if not (math.isfinite(self.symbol_rate) and self.symbol_rate > 0):
            raise ValueError(f"symbol_rate: {self.symbol_rate} is not allowed; a finite number > 0 Hz")
        if not 0 < self.roll_off <= 1:
            raise ValueError(f"roll_off: {self.roll_off} is not allowed; above 0, at most 1")

    @property
    def edges(self) -> tuple[float, float]:  # type: ignore[override]
        """See `Prefilter`."""
        half = 0.5 * self.symbol_rate * (1 + self.roll_off)
        return -half, half

    def response(self, frequency: ArrayLike) -> Array:
        """See `Prefilter.response`."""
        place = np.abs(np.asarray(frequency, dtype=float)) / self.symbol_rate
        inner = 0.5 * (1 - self.roll_off)
        return np.cos(0.5 * np.pi * np.clip((place - inner) / self.roll_off, 0.0, 1.0))

    def spectrum(self, frequency: ArrayLike) -> Array | None:
        """See `Prefilter.spectrum`."""
        return np.square(self.response(frequency))


class Shaped(Protocol):
    """Anything with a power spectrum, such as a waveform; frozen, so that equal ones share their tables."""

    @property
    def bandwidth(self) -> float:
        """Occupied band, both sides [Hz]."""

    def spectrum(self, frequency: Array) -> Array:
        """Return the power density [1/Hz] at frequencies from the centre [Hz], shape (...)."""


@dataclass(frozen=True)
class Matched(Prefilter):
    """The filter matched to a known spectrum: G = sqrt(S), its highest value in the band scaled to 1.

    Parameters
    ----------
    waveform : Shaped
        Whose spectrum it is; zero outside its bandwidth.
    """

    waveform: Shaped

    @property
    def edges(self) -> tuple[float, float]:  # type: ignore[override]
        """See `Prefilter`."""
        half = 0.5 * self.waveform.bandwidth
        return -half, half

    def response(self, frequency: ArrayLike) -> Array:
        """See `Prefilter.response`."""
        highest = self.waveform.spectrum(np.linspace(*self.edges, _GRID + 1)).max()
        density = self.spectrum(frequency)
        return np.sqrt(np.maximum(density, 0.0) / highest)

    def spectrum(self, frequency: ArrayLike) -> Array:
        """See `Prefilter.spectrum`."""
        f = np.asarray(frequency, dtype=float)
        return np.where(np.abs(f) <= self.edges[1], self.waveform.spectrum(f), 0.0)


@dataclass(frozen=True)
class Moments:
    r"""Spectral integrals of a prefilter, all over one period of the sampled spectrum.

    Attributes
    ----------
    frequency : ndarray, shape (n,)
        Grid [Hz].
    step : float
        Of the grid [Hz].
    weight : ndarray, shape (n,)
        :math:`W = G^2`.
    spectrum : ndarray, shape (n,) or None
        S, of unit area [1/Hz].
    """

    frequency: Array
    step: float
    weight: Array
    spectrum: Array | None

    @cached_property
    def noise_bandwidth(self) -> float:
        r""":math:`(\int W)^2/\int W^2` [Hz]: how many independent cells per second white noise has behind both."""
        return float(self.step * self.weight.sum() ** 2 / np.square(self.weight).sum())

    @cached_property
    def noise_cell(self) -> float:
        r"""Size of a cell of noise along the delay [s]: one over a flat band with its mean square frequency."""
        weight = np.square(self.weight) / np.square(self.weight).sum()
        mean = (weight * self.frequency).sum()
        return 1 / math.sqrt(12 * float((weight * np.square(self.frequency - mean)).sum()))

    @cached_property
    def pull(self) -> float:
        r"""What is left of a small shift of the spectrum behind the filter, :math:`1 + \int f S W'/\int S W`.

        One half for W = S; 1 where the spectrum is not known.
        """
        if self.spectrum is None:
            return 1.0
        slope = np.gradient(self.weight, self.step)
        return float(1 + (self.frequency * self.spectrum * slope).sum() / (self.spectrum * self.weight).sum())

    @cached_property
    def bandwidth_squared(self) -> float | None:
        r""":math:`\int (w-\bar w)^2 S W/\int S W` [rad^2/s^2], of the weighted cross-spectrum; None: not known."""
        if self.spectrum is None:
            return None
        product = self.spectrum * self.weight
        w = 2 * np.pi * self.frequency
        mean = (w * product).sum() / product.sum()
        return float((np.square(w - mean) * product).sum() / product.sum())


@lru_cache(maxsize=64)
def _moments(prefilter: Prefilter, sample_rate: float) -> Moments:
    step = sample_rate / _GRID
    frequency = step * np.arange(-_GRID // 2, _GRID // 2, dtype=np.float64)
    spectrum = prefilter.spectrum(frequency)
    if spectrum is not None:
        spectrum = spectrum / (spectrum.sum() * step)
    return Moments(frequency, step, np.square(prefilter.response(frequency)), spectrum)


@lru_cache(maxsize=16)
def _table(prefilter: Prefilter, size: int, sample_rate: float) -> NDArray[np.float32]:
    table = prefilter.response(fft.fftfreq(size, 1 / sample_rate)).astype(np.float32)
    table.setflags(write=False)
    return table
