"""The ranging equation along lines of sight: its value, its slope, and their sign changes by halving.

Lines are an array (6, lines) of rows p, d2, z, ez, turn, k as `quietfix.systems.fixes.ranging` has them; places along
them are (m, lines), so that neighbours in memory are independent of each other and are done several at a time.
"""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.compiling import compiled, inlined

__all__ = ["evaluate", "halve"]


@inlined
def _value(s: float, line: Any, i: int, mu: float, bulge: float) -> float:
    """Return f: with s = r + p the distance from the foot of the line."""
    p, d2, z0, ez, turn, k = line[0, i], line[1, i], line[2, i], line[3, i], line[4, i], line[5, i]
    square = s * s + d2
    cube = square * math.sqrt(square)
    out = turn * (s - p) - k - mu * s / cube
    if bulge != 0.0:
        z = z0 + (s - p) * ez
        out += bulge / (cube * square) * ((5 * z * z / square - 1) * s - 2 * z * ez)
    return out


@inlined
def _slope(s: float, line: Any, i: int, mu: float, bulge: float) -> float:
    """Return df/dr; times r_T^5 it is the paper's Dm, (35) with its square restored."""
    p, d2, z0, ez, turn = line[0, i], line[1, i], line[2, i], line[3, i], line[4, i]
    square = s * s + d2
    fifth = square * square * math.sqrt(square)
    out = turn - mu * (d2 - 2 * s * s) / fifth
    if bulge != 0.0:
        z = z0 + (s - p) * ez
        inner = (5 * z * z / square - 1) * s - 2 * z * ez
        change = 10 * z * s / square * (ez - z * s / square) + 5 * z * z / square - 1 - 2 * ez * ez
        out += bulge / fifth * (change - 5 * s / square * inner)
    return out


@compiled("void(boolean,float64[:,::1],float64,float64,float64[:,::1],float64[:,::1])")
def evaluate(slope: bool, line: Any, mu: float, bulge: float, places: Any, out: Any) -> None:
    """Write f, or its slope, at places (m, lines) into `out`."""
    for j in range(places.shape[0]):
        for i in range(places.shape[1]):
            if slope:
                out[j, i] = _slope(places[j, i], line, i, mu, bulge)
            else:
                out[j, i] = _value(places[j, i], line, i, mu, bulge)


@compiled("void(boolean,float64[:,::1],float64,float64,float64[::1],int64,float64[:,::1],float64[:,::1])")
def halve(slope: bool, line: Any, mu: float, bulge: float, rising: Any, times: int, half: Any, places: Any) -> None:
    """Move places (m, lines), the middles of intervals of `half` that length, to where f or its slope changes sign.

    `rising` (m,) is 1 where it rises in the interval and -1 where it falls.
    """
    for j in range(places.shape[0]):
        for _ in range(times):
            for i in range(places.shape[1]):
                half[j, i] *= 0.5
                if slope:
                    f = _slope(places[j, i], line, i, mu, bulge)
                else:
                    f = _value(places[j, i], line, i, mu, bulge)
                places[j, i] -= math.copysign(half[j, i], f * rising[j])
