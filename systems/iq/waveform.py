"""What an emitter sends: the contract of waveforms, and a waveform with its carrier and its random symbols."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["Emission", "Waveform", "positive_number"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


def positive_number(value: float, name: str, unit: str) -> None:
    """Raise ValueError unless `value` is finite and > 0."""
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"{name}: {value} is not allowed; a finite number > 0{' ' + unit if unit else ''}")


class Waveform(ABC):
    """A complex envelope of mean power 1 that can be evaluated at any time.

    Nothing random is kept: what is random in it (symbols) is a pure function of a seed, a name and the index of the
    symbol, so that two receivers which ask for different times hear the same signal.
    """

    @abstractmethod
    def envelope(self, times: ArrayLike, seed: int = 0, name: str = "emitter") -> ComplexArray:
        """Return the complex envelope.

        Parameters
        ----------
        times : array_like, shape (...)
            Times at the emitter [s]; finite.
        seed : int
            Seed of the study.
        name : str
            Name of the emitter: different names send different symbols.

        Returns
        -------
        ndarray of complex, shape (...)
        """

    @property
    @abstractmethod
    def bandwidth(self) -> float:
        """Width of the band that holds the signal, both sides of the carrier together [Hz]."""

    @property
    def noise_bandwidth(self) -> float:
        """Width of an ideal filter around the signal: the B of B T gamma and of Stein's formulae [Hz]."""
        return self.bandwidth

    @property
    @abstractmethod
    def rms_bandwidth(self) -> float:
        r"""Root of :math:`\int\omega^2 S\,d\omega/\int S\,d\omega`: the beta of Stein's formula [rad/s]."""

    @abstractmethod
    def spectrum(self, frequency: ArrayLike) -> Array:
        """Return the power density S [1/Hz] at frequencies from the carrier [Hz], shape (...); its integral is 1."""


@dataclass(frozen=True)
class Emission:
    """A waveform on the air. It is its own deep copy, so that it travels through ports at no cost.

    Parameters
    ----------
    waveform : Waveform
        The complex envelope.
    carrier : float
        Carrier frequency at the emitter [Hz], > 0.
    seed : int
        Seed of the symbols.
    name : str
        Name of the emitter, the other part of their key.
    """

    waveform: Waveform
    carrier: float
    seed: int = 0
    name: str = "emitter"

    def __post_init__(self) -> None:
        """Check the arguments."""
        positive_number(self.carrier, "carrier", "Hz")

    def __deepcopy__(self, memo: dict[int, Any]) -> Emission:
        return self

    def envelope(self, times: ArrayLike) -> ComplexArray:
        """Return the complex envelope at times of the emitter [s], shape (...)."""
        return self.waveform.envelope(times, self.seed, self.name)
