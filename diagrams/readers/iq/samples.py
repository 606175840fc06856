"""Samples as files write them: their types, and complex numbers of them.

Types are those of SigMF: ``c`` complex (I before Q) or ``r`` real; ``f``, ``i`` or ``u`` with so many bits; ``_le`` or
``_be``. Real samples become complex ones: see `analytic`.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

__all__ = ["SampleType", "analytic", "sample_type", "segments_of"]

_TYPE = re.compile(r"([cr])(f64|f32|i32|u32|i16|u16|i8|u8)(_le|_be)?")
_WORDS = "c or r, then f32, f64, i8, i16, i32, u8, u16 or u32, then _le or _be, such as ci16_le"

Convert = Callable[[NDArray[np.generic]], NDArray[np.float32]]


@dataclass(frozen=True)
class SampleType:
    """How a sample of one channel is written.

    Attributes
    ----------
    name : str
    complex : bool
        Whether it is I and Q.
    dtype : dtype
        Of one number.
    """

    name: str
    complex: bool
    dtype: np.dtype[np.generic]

    @property
    def size(self) -> int:
        """Bytes of a sample."""
        return int(self.dtype.itemsize) * (2 if self.complex else 1)

    def numbers(self, raw: NDArray[np.generic]) -> NDArray[np.float32]:
        """Return numbers as floats; those of whole ones are parts of their largest."""
        kind = self.dtype.kind
        if kind == "f":
            with np.errstate(over="ignore"):
                return raw.astype(np.float32)
        half = 2.0 ** (8 * self.dtype.itemsize - 1)
        wide: NDArray[np.floating] = raw.astype(np.float64 if self.dtype.itemsize == 4 else np.float32)
        return ((wide - (half if kind == "u" else 0.0)) / half).astype(np.float32)


def sample_type(name: object, endless: bool = False) -> SampleType:
    """Return the type of a name.

    Parameters
    ----------
    name : str
    endless : bool
        Whether it may leave out the order of the bytes of several, which is then little-endian.

    Raises
    ------
    ValueError
        If there is none.
    """
    found = _TYPE.fullmatch(name) if isinstance(name, str) else None
    if found is None or not (found[3] or endless or found[2] in ("i8", "u8")):
        raise ValueError(f"{str(name)[:60]} is not allowed; {_WORDS}")
    order = ">" if found[3] == "_be" else "<"
    return SampleType(str(name), found[1] == "c", np.dtype(f"{order}{found[2][0]}{int(found[2][1:]) // 8}"))


def segments_of(
    raw: NDArray[np.generic], channels: int, complex_: bool, convert: Convert
) -> list[NDArray[np.complex64]]:
    """Return the samples of each channel, complex ones, from numbers that lie beside each other.

    Parameters
    ----------
    raw : ndarray, shape (n * channels * (2 or 1),)
    channels : int
    complex_ : bool
        Whether two numbers are a sample; otherwise one, and there are half as many complex ones.
    convert : callable
        Makes floats of numbers.
    """
    width = 2 if complex_ else 1
    table = raw.reshape(-1, channels, width)
    if complex_:
        return [np.ascontiguousarray(convert(table[:, i])).view(np.complex64).reshape(-1) for i in range(channels)]
    return [analytic(convert(table[:, i, 0])) for i in range(channels)]


def analytic(real: NDArray[np.floating]) -> NDArray[np.complex64]:
    """Return the analytic signal of real samples at half their rate, about a quarter of it (Hilbert transform).

    What is at the frequency f, from 0 to half of the real sample rate r, comes out at f - r/4: a band of white noise
    is white again. A last odd sample is left out. The transform takes the samples for a period, which disturbs some at
    both ends.
    """
    half = real.size // 2
    if half == 0:
        return np.zeros(0, np.complex64)
    with np.errstate(invalid="ignore", over="ignore"):
        spectrum = fft.rfft(real[: 2 * half])[:half] * 2
        spectrum[0] /= 2
        # the quarter of the rate comes to 0: its bin need not be a whole one, so that is done in time
        found = fft.ifft(spectrum) * 0.5
    k = np.arange(half)
    return (found * np.exp(-1j * np.pi * (k % 2))).astype(np.complex64)
