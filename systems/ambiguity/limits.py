"""How long two blocks may be integrated before motion smears the peak."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["check_duration", "longest_duration"]

_COMPANDING, _CHIRP = 0.5, 0.1


def longest_duration(delay_rate: ArrayLike, frequency_rate: ArrayLike, bandwidth: float) -> float:
    """Return the longest integration time [s]; infinite where nothing moves.

    The delay may change by half of 1/B (companding), and the phase of a drifting frequency by ``|fdot| T^2 / 4 <= 0.1``
    cycles: beyond, the peak loses height, then splits.

    Parameters
    ----------
    delay_rate : array_like
        Rate of the TDOA [s/s]; all of them are kept.
    frequency_rate : array_like
        Rate of the FDOA [Hz/s].
    bandwidth : float
        B [Hz].
    """
    companding, chirp = np.max(np.abs(delay_rate)), np.max(np.abs(frequency_rate))
    limits = [math.inf]
    if companding > 0:
        limits.append(_COMPANDING / (companding * bandwidth))
    if chirp > 0:
        limits.append(math.sqrt(4 * _CHIRP / chirp))
    return float(min(limits))


def check_duration(duration: float, delay_rate: ArrayLike, frequency_rate: ArrayLike, bandwidth: float) -> None:
    """Raise ValueError if the integration time is too long for the rates; see `longest_duration`."""
    longest = longest_duration(delay_rate, frequency_rate, bandwidth)
    if not duration <= longest:
        raise ValueError(
            f"integration time: {1e3 * duration:.4g} ms is not allowed; at most {1e3 * longest:.4g} ms while the TDOA "
            f"drifts by {np.max(np.abs(delay_rate)):.3g} s/s and the FDOA by {np.max(np.abs(frequency_rate)):.3g} Hz/s "
            f"in {1e-6 * bandwidth:.4g} MHz (|taudot| B T <= {_COMPANDING}, |fdot| T^2/4 <= {_CHIRP})"
        )
