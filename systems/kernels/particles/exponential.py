"""The exponential of a number that is not above 0, by arithmetic alone: loops over it are done several at a time."""

from __future__ import annotations

from typing import Any

import numpy as np

from quietfix.systems.kernels.compiling import inlined

__all__ = ["exponential"]

_WHOLE = 6755399441055744.0  # 1.5 * 2^52: what is added to it has its nearest whole number in the last bits
_ONE = np.int64(1023 << 52)


@inlined
def exponential(x: Any) -> float:
    """Return e^x of an x <= 0 within 2 units in the last place; 0 below -708 and for NaN.

    Moshier, *Cephes Mathematical Library*, exp.c: a rational function of what is left of x by the nearest multiple of
    log 2, in two parts, times that power of 2.
    """
    bounded = x if x > -708.0 else -708.0
    shifted = bounded * 1.4426950408889634073599 + _WHOLE
    whole = shifted - _WHOLE
    rest = bounded - whole * 6.93145751953125e-1 - whole * 1.42860682030941723212e-6
    z = rest * rest
    p = 1.26177193074810590878e-4
    p = p * z + 3.02994407707441961300e-2
    p = (p * z + 9.99999999999999999910e-1) * rest
    q = 3.00198505138664455042e-6
    q = q * z + 2.52448340349684104192e-3
    q = q * z + 2.27265548208155028766e-1
    q = q * z + 2.00000000000000000009e0
    power = np.int64((np.float64(shifted).view(np.int64) << np.int64(52)) + _ONE).view(np.float64)
    return (1.0 + 2.0 * (p / (q - p))) * power if x > -708.0 else 0.0
