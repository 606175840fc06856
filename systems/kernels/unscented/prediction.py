"""The unscented prediction of many trials, one after the other."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.calling import call_kernel
from quietfix.systems.kernels.compiling import compiled, inlined
from quietfix.systems.kernels.matrices import cholesky

__all__ = ["predict"]


@compiled(
    "int64(float64[:,::1],float64[:,:,::1],float64[:,:,::1],int64[:,::1],float64[::1],float64[:,:,::1],"
    "float64,float64,float64,float64[:,:,::1],float64[:,::1],float64[:,:,::1])"
)
def predict(
    mean: Any,
    covariance: Any,
    inputs: Any,
    parts: Any,
    parameters: Any,
    noise: Any,
    c: float,
    weight: float,
    centre: float,
    space: Any,
    out_mean: Any,
    out_covariance: Any,
) -> int:
    """Send 2 n + 1 sigma points through a motion; arguments as of `quietfix.systems.kernels.predicting.by_kernel`.

    `c`, `weight` and `centre` are those of `quietfix.systems.kernels.unscented.update.update`; `space` is (7, n, n).

    Returns
    -------
    int
        -1, or (trial 256 + part) of a kernel that raised.
    """
    n = mean.shape[1]
    root, plus, minus, q = space[0], space[1], space[2], space[3]
    middle, point, shift = space[4, 0], space[5, 0], space[6, 0]
    begin, end = parts[0, 3], parts[0, 4]
    for t in range(mean.shape[0]):
        if not cholesky(mean, covariance, t, space[1:4], root):
            for i in range(n):
                out_mean[t, i] = math.nan
                for j in range(n):
                    out_covariance[t, i, j] = math.nan
            continue
        given, own = inputs[t if inputs.shape[0] > 1 else 0], noise[0]
        if parts.shape[0] > 1:
            own = q
            for i in range(n):
                for j in range(n):
                    q[i, j] = 0.0
            if call_kernel(parts[1, 0], mean[t], given, parameters[parts[1, 3] : parts[1, 4]], middle, q):
                return t * 256 + 1
        if call_kernel(parts[0, 0], mean[t], given, parameters[begin:end], middle, root[:0]):
            return t * 256
        for k in range(n):
            for sign in range(2):
                for i in range(n):
                    point[i] = mean[t, i] + c * root[i, k] if sign == 0 else mean[t, i] - c * root[i, k]
                moved = plus[k] if sign == 0 else minus[k]
                if call_kernel(parts[0, 0], point, given, parameters[begin:end], moved, root[:0]):
                    return t * 256
        _moments(t, plus, minus, middle, weight, centre, own, shift, out_mean, out_covariance)
    return -1


@inlined
def _moments(
    t: int,
    plus: Any,
    minus: Any,
    middle: Any,
    weight: float,
    centre: float,
    noise: Any,
    shift: Any,
    out_mean: Any,
    out_covariance: Any,
) -> None:
    """Write mean and covariance of the moved points, noise added; a row of `plus` and `minus` is a point."""
    n = plus.shape[0]
    for i in range(n):
        total = 0.0
        for k in range(n):
            plus[k, i] -= middle[i]
            minus[k, i] -= middle[i]
            total += plus[k, i] + minus[k, i]
        shift[i] = weight * total
        out_mean[t, i] = middle[i] + shift[i]
        for k in range(n):
            plus[k, i] -= shift[i]
            minus[k, i] -= shift[i]
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                total += plus[k, i] * plus[k, j]
            for k in range(n):
                total += minus[k, i] * minus[k, j]
            spread = weight * total + centre * shift[i] * shift[j]
            out_covariance[t, i, j] = spread + noise[i, j]
            if j < i:
                out_covariance[t, j, i] = spread + noise[j, i]
