"""Coherent train of linear-FM pulses."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.systems.iq.waveform import Waveform, positive_number

__all__ = ["PulseTrain"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_OVERSAMPLING = 32  # of the pulse, for its spectrum


@dataclass(frozen=True)
class PulseTrain(Waveform):
    """Linear-FM pulses, all alike and coherent, one every repetition interval for ever.

    Nothing in it is random. Because all pulses are alike, frequency differences are ambiguous by ``1/interval`` and
    delays by `interval`.

    Parameters
    ----------
    sweep : float
        What the instantaneous frequency runs through, upwards, symmetric to the carrier [Hz], > 0.
    width : float
        Length of a pulse [s], > 0 and at most `interval`.
    interval : float
        Pulse repetition interval [s], > 0; pulses are centred on its multiples.
    edge : float
        Share of the pulse in its two raised-cosine edges, 0 to 1. With hard edges the band would never end.
    """

    sweep: float = 2e6
    width: float = 50e-6
    interval: float = 1e-3
    edge: float = 0.1

    def __post_init__(self) -> None:
        """Check the arguments."""
        for name, unit in (("sweep", "Hz"), ("width", "s"), ("interval", "s")):
            positive_number(getattr(self, name), name, unit)
        if self.width > self.interval:
            raise ValueError(f"width: {self.width} s is not allowed; at most the interval {self.interval} s")
        if not 0 <= self.edge <= 1:
            raise ValueError(f"edge: {self.edge} is not allowed; a number from 0 to 1")

    @property
    def _amplitude(self) -> float:
        """Height of the pulses that makes the mean power 1; a raised-cosine edge has 3/8 of a box's energy."""
        return math.sqrt(self.interval / (self.width * (1 - 5 / 8 * self.edge)))

    def _taper(self, place: Array) -> Array:
        """Return the pulse's amplitude at `place` seconds from its centre."""
        inside = 0.5 * self.width - np.abs(place)
        if self.edge == 0:
            return np.where(inside > 0, 1.0, 0.0)
        return 0.5 - 0.5 * np.cos(np.pi * np.clip(inside / (0.5 * self.edge * self.width), 0.0, 1.0))

    def _pulse(self, place: Array) -> ComplexArray:
        return self._taper(place) * np.exp(1j * np.pi * self.sweep / self.width * place**2)

    def envelope(self, times: ArrayLike, seed: int = 0, name: str = "emitter") -> ComplexArray:
        """See `Waveform.envelope`; the same for every seed and name."""
        t = np.asarray(times, dtype=float)
        if not np.all(np.isfinite(t)):
            raise ValueError("times: all must be finite")
        place = t - self.interval * np.round(t / self.interval)
        out = np.zeros(t.shape, dtype=complex)
        on = np.abs(place) < 0.5 * self.width
        out[on] = self._amplitude * self._pulse(place[on])
        return out

    @property
    def bandwidth(self) -> float:
        """See `Waveform`: the sweep [Hz]; a hundredth of the power or so lies beyond it."""
        return self.sweep

    @property
    def rms_bandwidth(self) -> float:
        """See `Waveform` [rad/s], of the pulse's spectrum."""
        return _rms_bandwidth(self)

    def spectrum(self, frequency: ArrayLike) -> Array:
        """See `Waveform.spectrum`: of one pulse; that of the train has lines ``1/interval`` apart under it."""
        known, density = _spectrum(self)
        return np.interp(np.asarray(frequency, dtype=float), known, density, left=0.0, right=0.0)


def _sampled(train: PulseTrain) -> tuple[float, ComplexArray]:
    """Return the time step and a pulse, zero-padded to four times its length."""
    count = 2 ** math.ceil(math.log2(_OVERSAMPLING * max(train.sweep * train.width, 8.0)))
    step = train.width / count
    place = (np.arange(count) - 0.5 * (count - 1)) * step
    return step, np.concatenate([train._pulse(place), np.zeros(3 * count)])


@lru_cache(maxsize=16)
def _spectrum(train: PulseTrain) -> tuple[Array, Array]:
    step, pulse = _sampled(train)
    density = np.fft.fftshift(np.abs(np.fft.fft(pulse)) ** 2)
    frequency = np.fft.fftshift(np.fft.fftfreq(pulse.size, step))
    density /= density.sum() * (frequency[1] - frequency[0])
    return frequency, density


@lru_cache(maxsize=16)
def _rms_bandwidth(train: PulseTrain) -> float:
    frequency, density = _spectrum(train)
    return float(2 * math.pi * np.sqrt((frequency**2 * density).sum() / density.sum()))
