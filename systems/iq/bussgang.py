r"""What quantising and clipping do to a Gaussian signal: less of it, and noise.

With x of variance 1, a quantiser Q is :math:`Q(x) = \alpha x + d`, where d is uncorrelated with x and with everything
that is jointly Gaussian with x (J. J. Bussgang, MIT RLE report 216, 1952). In Hermite polynomials, :math:`E\,Q(x)Q(y) =
\sum_k c_k^2\rho^k` for the correlation rho of x and y, :math:`c_1 = \alpha`, so that the distortion's own correlation
is

.. math:: R_d(\rho) = \sum_{k\ge3} c_k^2 \rho^k .

For one bit that is the arcsine law, :math:`c_k^2` the terms of :math:`(2/\pi)\arcsin\rho` in units of the level squared
(J. H. Van Vleck and D. Middleton, Proc. IEEE 54 (1966) 2): :math:`R_d(0)/\alpha^2 = \pi/2 - 1`, the loss of 2/pi.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

__all__ = ["Quantiser"]

Array = NDArray[np.float64]

_TERMS = 41  # highest order; behind it there is less than 1 % of what one bit distorts, at lag 0 counted otherwise
_FINEST = 1e-4  # step in standard deviations below which its noise, step^2/12, is nothing
_REACH = 10.0  # standard deviations that do not occur


@dataclass(frozen=True)
class Quantiser:
    """What `quietfix.systems.iq.quantise.quantise` does, in the mean.

    Parameters
    ----------
    bits : int
        Of each of I and Q, 1 to 24.
    full_scale : float
        Clipping level in standard deviations of I and Q, > 0.
    """

    bits: int
    full_scale: float = 4.0

    @cached_property
    def _steps(self) -> tuple[float, Array]:
        """Width of a step, and the thresholds > 0 between steps, in standard deviations."""
        bits = self.bits
        while bits > 1 and self.full_scale / 2 ** (bits - 1) < _FINEST and 2 ** (bits - 2) > 1e4:
            bits -= 1
        step = self.full_scale / 2 ** (bits - 1)
        count = min(2 ** (bits - 1) - 1, math.ceil(_REACH / step))
        return step, step * np.arange(1, count + 1)

    @cached_property
    def _squares(self) -> tuple[Array, float]:
        r""":math:`c_k^2` of odd k from 1, and the mean square of Q, in squared standard deviations."""
        step, thresholds = self._steps
        # Q rises by a step at 0 and at each threshold on both sides: c_k = sum of step phi(t) He_{k-1}(t) / sqrt(k!)
        places = np.concatenate([[0.0], thresholds])
        weight = step * np.where(places > 0, 2.0, 1.0) * np.exp(-0.5 * places**2) / math.sqrt(2 * math.pi)
        before, this = np.zeros_like(places), np.ones_like(places)  # He_k / sqrt(k!)
        squares = []
        for k in range(_TERMS):
            if k % 2 == 0:
                squares.append(float((weight * this).sum()) ** 2 / (k + 1))
            before, this = this, (places * this - math.sqrt(k) * before) / math.sqrt(k + 1)
        power = step**2 * (0.25 + 4.0 * float((np.arange(1, places.size) * ndtr(-thresholds)).sum()))
        return np.array(squares), power

    @property
    def gain(self) -> float:
        """Alpha: what of the signal comes through."""
        return math.sqrt(self._squares[0][0])

    @property
    def noise(self) -> float:
        r"""Distortion over what comes through of the whole input, :math:`R_d(1)/\alpha^2`, a ratio of powers."""
        squares, power = self._squares
        return max(power / squares[0] - 1.0, 0.0)

    def correlation(self, rho: ArrayLike) -> Array:
        r"""Return :math:`R_d(\rho)/\alpha^2`, shape (...); at rho = 1 it is `noise`."""
        r = np.asarray(rho, dtype=float)
        squares, _ = self._squares
        series = r * np.polynomial.polynomial.polyval(r**2, np.concatenate([[0.0], squares[1:] / squares[0]]))
        return np.where(r >= 1, self.noise, series)

    def slope(self, rho: ArrayLike) -> Array:
        r"""Return the derivative of `correlation`, shape (...), for abs(rho) < 1."""
        r = np.asarray(rho, dtype=float)
        squares, _ = self._squares
        order = 2 * np.arange(squares.size) + 1
        return np.polynomial.polynomial.polyval(r**2, np.where(order > 1, order * squares / squares[0], 0.0))
