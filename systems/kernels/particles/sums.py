"""Sums over particles, several at a time: in another order than one after the other, but always in the same."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.compiling import inlined, summing
from quietfix.systems.kernels.particles.exponential import exponential

__all__ = ["largest", "powers", "product", "total"]


@summing
def total(one: Any) -> float:
    """Return the sum."""
    found = 0.0
    for j in range(one.shape[0]):
        found += one[j]
    return found


@summing
def product(one: Any, other: Any) -> float:
    """Return the sum of the products."""
    found = 0.0
    for j in range(one.shape[0]):
        found += one[j] * other[j]
    return found


@inlined
def largest(one: Any) -> float:
    """Return the largest of numbers of which none is NaN; -inf without one."""
    a = b = c = d = -math.inf
    whole = one.shape[0] // 4 * 4
    for j in range(0, whole, 4):
        a, b = (one[j] if one[j] > a else a), (one[j + 1] if one[j + 1] > b else b)
        c, d = (one[j + 2] if one[j + 2] > c else c), (one[j + 3] if one[j + 3] > d else d)
    for j in range(whole, one.shape[0]):
        a = one[j] if one[j] > a else a
    return max(max(a, b), max(c, d))


@summing
def powers(logarithm: Any, highest: float, exponent: float, weight: Any, alike: bool) -> Any:
    """Return the sums of w v and of w v^2, v = exp(exponent (logarithm - highest)); w = 1 where they are `alike`."""
    first = second = 0.0
    if alike:
        for j in range(logarithm.shape[0]):
            value = exponential(exponent * (logarithm[j] - highest))
            first += value
            second += value * value
    else:
        for j in range(logarithm.shape[0]):
            value = exponential(exponent * (logarithm[j] - highest))
            first += weight[j] * value
            second += weight[j] * value * value
    return first, second
