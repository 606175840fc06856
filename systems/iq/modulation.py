"""Waveforms made of root-raised-cosine pulses: QPSK and band-limited noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from quietfix.systems.iq.root_raised_cosine import pulse_coefficients, pulse_sum, raised_cosine, rms_width
from quietfix.systems.iq.waveform import Waveform, positive_number
from quietfix.systems.noise import uniform

__all__ = ["BandLimitedNoise", "Qpsk"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_BLOCK = 2048  # symbols that are drawn, and intervals that are made, together
_ORIGIN = 2**40  # index of the block of symbol 0: times may be negative, counters may not
_SPAN = 32  # symbol intervals; the pulses have fallen to 3e-4 (alpha 0.25)
_MOST_BLOCKS = 2**11


def _draws(first: int, count: int, per_symbol: int, seed: int, name: str) -> Array:
    """Return uniform numbers (count, per_symbol): a function of the index of the symbol alone."""
    start, end = first // _BLOCK, (first + count - 1) // _BLOCK + 1
    drawn = uniform(seed, name + "/symbols", _ORIGIN + start, end - start, 0, per_symbol * _BLOCK)
    drawn = drawn.reshape(-1, per_symbol)
    return drawn[first - start * _BLOCK :][:count]


class _Modulation(Waveform):
    """A sum of root-raised-cosine pulses, one every symbol interval."""

    roll_off: float

    @property
    def _rate(self) -> float:
        """Symbol intervals per second [Hz]."""
        raise NotImplementedError

    @property
    def _stretch(self) -> float:
        """Symbol period of the pulse in symbol intervals."""
        return 1.0

    @property
    def _pulse_rate(self) -> float:
        return self._rate / self._stretch

    def symbols(self, first: int, count: int, seed: int = 0, name: str = "emitter") -> ComplexArray:
        """Return symbols ``first ... first + count - 1`` (any integers), shape (count,), of mean power 1."""
        raise NotImplementedError

    def envelope(self, times: ArrayLike, seed: int = 0, name: str = "emitter") -> ComplexArray:
        """See `Waveform.envelope`; the centre of the pulse of symbol k is at k symbol intervals."""
        position = np.asarray(times, dtype=float) * self._rate
        if position.size == 0:
            return np.zeros(position.shape, dtype=complex)
        low, high = float(np.min(position)), float(np.max(position))
        if not (math.isfinite(low) and math.isfinite(high)):
            raise ValueError("times: all must be finite")
        start, end = math.floor(low) // _BLOCK, math.floor(high) // _BLOCK + 1
        if end - start > _MOST_BLOCKS:
            raise ValueError(
                f"times: they spread over {(end - start) * _BLOCK} symbols; at most {_MOST_BLOCKS * _BLOCK} at once"
            )
        coefficients = np.concatenate([_coefficients(self, block, seed, name) for block in range(start, end)], axis=-1)
        return pulse_sum(position, start * _BLOCK, coefficients)

    @property
    def rms_bandwidth(self) -> float:
        """See `Waveform` [rad/s]."""
        return 2 * math.pi * self._pulse_rate * rms_width(self.roll_off)

    def spectrum(self, frequency: ArrayLike) -> Array:
        """See `Waveform.spectrum`: a raised cosine."""
        return raised_cosine(np.asarray(frequency) / self._pulse_rate, self.roll_off) / self._pulse_rate


@lru_cache(maxsize=64)  # 23 MB: the blocks that several receivers ask for at one epoch
def _coefficients(waveform: _Modulation, block: int, seed: int, name: str) -> ComplexArray:
    symbols = waveform.symbols(block * _BLOCK - _SPAN + 1, _BLOCK + 2 * _SPAN - 1, seed, name)
    coefficients = pulse_coefficients(symbols, waveform.roll_off, _SPAN, waveform._stretch)
    coefficients.setflags(write=False)
    return coefficients


def _check_roll_off(roll_off: float) -> None:
    if not 0 <= roll_off <= 1:
        raise ValueError(f"roll_off: {roll_off} is not allowed; a number from 0 to 1")


@dataclass(frozen=True)
class Qpsk(_Modulation):
    """Four-phase keying with root-raised-cosine pulses, never ending, of random symbols.

    Parameters
    ----------
    symbol_rate : float
        [Bd], > 0.
    roll_off : float
        Alpha of the pulses, 0 to 1.

    Notes
    -----
    Pulses are cut 32 symbols from their centre, where they have fallen to 3e-4 (alpha 0.25).
    """

    symbol_rate: float = 2e6
    roll_off: float = 0.25

    def __post_init__(self) -> None:
        """Check the arguments."""
        positive_number(self.symbol_rate, "symbol_rate", "Bd")
        _check_roll_off(self.roll_off)

    @property
    def _rate(self) -> float:
        return self.symbol_rate

    def symbols(self, first: int, count: int, seed: int = 0, name: str = "emitter") -> ComplexArray:
        """Return symbols ``first ... first + count - 1`` (any integers), shape (count,), of modulus 1."""
        quadrant = np.floor(4 * _draws(first, count, 1, seed, name)[:, 0]).astype(np.intp)
        return np.exp(0.25j * np.pi * np.array([1, 3, 5, 7]))[quadrant]

    @property
    def bandwidth(self) -> float:
        """See `Waveform`: (1 + alpha) times the symbol rate [Hz]."""
        return (1 + self.roll_off) * self.symbol_rate


@dataclass(frozen=True)
class BandLimitedNoise(_Modulation):
    """Stationary complex Gaussian noise whose spectrum is flat with cosine edges.

    White Gaussian numbers at the rate of the whole band, through a pulse that has nothing outside it: no spectral
    replica reaches into the band, hence stationary.

    Parameters
    ----------
    band : float
        Two-sided width beyond which there is nothing [Hz], > 0.
    roll_off : float
        Width of both cosine edges together, as a share of the width at half power; 0 to 1.
    """

    band: float = 2.5e6
    roll_off: float = 0.25

    def __post_init__(self) -> None:
        """Check the arguments."""
        positive_number(self.band, "band", "Hz")
        _check_roll_off(self.roll_off)

    @property
    def _rate(self) -> float:
        return self.band

    @property
    def _stretch(self) -> float:
        return 1 + self.roll_off

    def symbols(self, first: int, count: int, seed: int = 0, name: str = "emitter") -> ComplexArray:
        """Return the white Gaussian numbers ``first ... first + count - 1``, shape (count,)."""
        white = ndtri(_draws(first, count, 2, seed, name)) / math.sqrt(2)
        return white[:, 0] + 1j * white[:, 1]

    @property
    def bandwidth(self) -> float:
        """See `Waveform` [Hz]."""
        return self.band
