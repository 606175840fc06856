"""The root-raised-cosine pulse: closed form, and sums of many such pulses at arbitrary times."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike, NDArray

__all__ = ["pulse", "pulse_coefficients", "pulse_sum", "raised_cosine", "rms_width"]

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

_SINGULAR = 1e-8  # the limit is off by this times the slope, the quotient by rounding over this
_DEGREE = 10


def pulse(x: ArrayLike, roll_off: float) -> Array:
    r"""Return the root-raised-cosine pulse of unit energy and unit symbol period.

    .. math:: h(x) = \frac{\sin \pi x(1-\alpha) + 4\alpha x\cos \pi x(1+\alpha)}{\pi x\,(1 - (4\alpha x)^2)}

    with its limits :math:`1 - \alpha + 4\alpha/\pi` at x = 0 and
    :math:`\frac{\alpha}{\sqrt 2}[(1+\frac2\pi)\sin\frac{\pi}{4\alpha} + (1-\frac2\pi)\cos\frac{\pi}{4\alpha}]` at
    :math:`x = \pm 1/(4\alpha)` (Proakis and Salehi, *Digital Communications*, 5th ed., section 9.2).

    Parameters
    ----------
    x : array_like, shape (...)
        Time in symbol periods.
    roll_off : float
        Alpha, 0 to 1.

    Returns
    -------
    ndarray, shape (...)
    """
    place = np.asarray(x, dtype=float)
    a = roll_off
    hole = 1 - (4 * a * place) ** 2
    centre, edge = np.abs(place) < _SINGULAR, np.abs(hole) < _SINGULAR
    safe_x, safe_hole = np.where(centre | edge, 1.0, place), np.where(centre | edge, 1.0, hole)
    value = (np.sin(np.pi * safe_x * (1 - a)) + 4 * a * safe_x * np.cos(np.pi * safe_x * (1 + a))) / (
        np.pi * safe_x * safe_hole
    )
    value = np.where(centre, 1 - a + 4 * a / np.pi, value)
    if a > 0:
        angle = np.pi / (4 * a)
        limit = a / np.sqrt(2) * ((1 + 2 / np.pi) * np.sin(angle) + (1 - 2 / np.pi) * np.cos(angle))
        value = np.where(edge, limit, value)
    return value


def raised_cosine(x: ArrayLike, roll_off: float) -> Array:
    """Return the power spectrum of the pulse, shape (...), at frequencies `x` in symbol rates; its integral is 1."""
    place = np.abs(np.asarray(x, dtype=float))
    flat = (1 - roll_off) / 2
    if roll_off == 0:
        return np.where(place <= flat, 1.0, 0.0)
    slope = 0.5 * (1 + np.cos(np.pi * np.clip((place - flat) / roll_off, 0.0, 1.0)))
    return np.where(place >= (1 + roll_off) / 2, 0.0, slope)


def rms_width(roll_off: float) -> float:
    """Return the root of the second moment of `raised_cosine`.

    It is the convolution of a box of width 1 with a half cosine of width alpha, so the variances add.
    """
    return float(np.sqrt(1 / 12 + roll_off**2 * (1 / 4 - 2 / np.pi**2)))


@lru_cache(maxsize=16)
def _pieces(roll_off: float, span: int, stretch: float) -> Array:
    """Return the pulse as polynomials, shape (degree + 1, 2 span), highest power first.

    Column i belongs to the symbol ``i - span + 1`` places after the start of the interval in which the time lies: the
    pulse at ``(u + 1/2 - (i - span + 1))/stretch`` as a polynomial in u from -1/2 to 1/2.
    """
    nodes = chebyshev.chebpts1(4 * _DEGREE) / 2
    places = np.arange(2 * span) - span + 1
    values = pulse((nodes[:, None] + 0.5 - places) / stretch, roll_off) / np.sqrt(stretch)
    series = chebyshev.chebfit(2 * nodes, values, _DEGREE)
    # a polynomial in 2u becomes one in u
    powers = np.array([chebyshev.cheb2poly(column) for column in series.T]).T * 2.0 ** np.arange(_DEGREE + 1)[:, None]
    table = np.ascontiguousarray(powers[::-1])
    table.setflags(write=False)
    return table


def pulse_coefficients(symbols: ArrayLike, roll_off: float, span: int, stretch: float) -> ComplexArray:
    r"""Return sums of pulses as polynomials, one for each symbol interval.

    Inside one symbol interval every pulse is a polynomial of the place in it, to 1e-8; so is their sum
    :math:`\sum_k a_k\,h((x-k)/\sigma)/\sqrt\sigma`, whose coefficients are convolutions of the symbols with a table
    (Farrow, *A continuously variable digital delay element*, ISCAS 1988). A sample then costs one Horner evaluation
    however many pulses reach it.

    Parameters
    ----------
    symbols : array_like of complex, shape (intervals + 2 span - 1,)
        From the one ``span - 1`` before the first interval to the one ``span`` after the last.
    roll_off : float
        Of the pulse, 0 to 1.
    span : int
        Pulses are cut this many symbol intervals from their centre.
    stretch : float
        Sigma: symbol period of the pulse in symbol intervals; 1 for data.

    Returns
    -------
    ndarray of complex, shape (degree + 1, intervals)
        Highest power first, of u = x - floor(x) - 1/2.
    """
    table = _pieces(float(roll_off), int(span), float(stretch))
    parts = np.stack([np.real(symbols), np.imag(symbols)])
    intervals = parts.shape[-1] - 2 * span + 1
    windows = np.ascontiguousarray(np.lib.stride_tricks.sliding_window_view(parts, intervals, axis=-1))
    out = np.empty((table.shape[0], intervals), dtype=complex)
    out.real, out.imag = table @ windows
    return out


def pulse_sum(position: Array, first: int, coefficients: ComplexArray) -> ComplexArray:
    """Evaluate what `pulse_coefficients` returned.

    Parameters
    ----------
    position : ndarray, shape (...)
        x: time in symbol intervals.
    first : int
        Index of the first interval of `coefficients`, which must reach from ``min(floor(x))`` to ``max(floor(x))``.
    coefficients : ndarray of complex, shape (degree + 1, intervals)

    Returns
    -------
    ndarray of complex, shape (...)
    """
    interval = np.floor(position)
    u = position - interval - 0.5
    index = interval.astype(np.intp) - first
    value = coefficients[0][index]
    for power in coefficients[1:]:
        value *= u
        value += power[index]
    return value
