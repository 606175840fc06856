"""Standard normal numbers of NumPy's generator SFC64, the same bits in a quarter of the time.

NumPy calls its generator by a pointer for every number. Here it is part of the loop.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba.np.random._constants import fi_double, ki_double, wi_double, ziggurat_nor_inv_r, ziggurat_nor_r

from quietfix.systems.kernels.compiling import compiled, inlined

__all__ = ["draw", "fill"]

_WORD = np.uint64
_ULP = 1.0 / 9007199254740992.0


@compiled("void(uint64[::1],float64[::1])")
def fill(state: Any, out: Any) -> None:
    """See `draw`."""
    draw(state, out)


@inlined
def draw(state: Any, out: Any) -> None:
    """Write what ``numpy.random.Generator(SFC64).standard_normal`` draws from this state (4,), which moves on.

    The ziggurat of Marsaglia and Tsang, J. Statistical Software 5 (2000) 8, with NumPy's tables; the generator is
    Doty-Humphrey's small fast chaotic one, of 256 bits.
    """
    i, count = 0, out.shape[0]
    a, b, c, d = state[0], state[1], state[2], state[3]  # in registers: for all the compiler knows, `out` overlaps it
    while i < count:
        word, a, b, c, d = _next(a, b, c, d)
        layer = word & _WORD(0xFF)
        place = (word >> _WORD(9)) & _WORD(0x000FFFFFFFFFFFFF)
        x = float(np.int64(place)) * wi_double[layer]
        if (word >> _WORD(8)) & _WORD(1):
            x = -x
        if place < ki_double[layer]:
            out[i] = x
            i += 1
        elif layer == _WORD(0):
            beyond, a, b, c, d = _beyond(a, b, c, d)
            out[i] = -beyond if (place >> _WORD(8)) & _WORD(1) else beyond
            i += 1
        else:
            low, high = fi_double[layer], fi_double[layer - _WORD(1)]
            word, a, b, c, d = _next(a, b, c, d)
            if (high - low) * _uniform(word) + low < math.exp(-0.5 * x * x):
                out[i] = x
                i += 1
    state[0], state[1], state[2], state[3] = a, b, c, d


@inlined
def _next(a: Any, b: Any, c: Any, d: Any) -> Any:
    """Return the next word of the generator, and its state then."""
    word = a + b + d
    return word, b ^ (b >> _WORD(11)), c + (c << _WORD(3)), ((c << _WORD(24)) | (c >> _WORD(40))) + word, d + _WORD(1)


@inlined
def _uniform(word: Any) -> float:
    return float(np.int64(word >> _WORD(11))) * _ULP


@inlined
def _beyond(a: Any, b: Any, c: Any, d: Any) -> Any:
    """Return a number beyond the ziggurat's last layer, and the state of the generator then."""
    while True:
        one, a, b, c, d = _next(a, b, c, d)
        other, a, b, c, d = _next(a, b, c, d)
        x = -ziggurat_nor_inv_r * math.log1p(-_uniform(one))
        y = -math.log1p(-_uniform(other))
        if y + y > x * x:
            return ziggurat_nor_r + x, a, b, c, d
