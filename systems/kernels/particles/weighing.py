"""What a measurement says of every particle, and the moments of a weighted cloud."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.compiling import compiled, inlined, summing
from quietfix.systems.kernels.rows import evaluate, wrapped

__all__ = ["likelihoods", "moments", "residuals"]

_BLOCK = 512  # particles at a time, so that a block stays in the nearest cache


@compiled(
    "int64(float64[:,:,::1],float64[:,::1],float64[:,:,::1],int64[:,::1],int64[::1],float64[::1],float64[::1],"
    "float64[::1],float64[:,::1],float64[:,:,::1])"
)
def residuals(
    cloud: Any,
    measured: Any,
    platforms: Any,
    parts: Any,
    chosen: Any,
    parameters: Any,
    moduli: Any,
    space: Any,
    none: Any,
    out: Any,
) -> int:
    """Write measured (trials, m) minus predicted for clouds (trials, n, N), shape (trials, m, N).

    `platforms` hold one for all trials or one for each; `space` has room for one state and all rows of the kernels;
    `none` is (0, n).

    Returns
    -------
    int
        -1, or (trial N + particle) 256 + part where a kernel raised.
    """
    trials, n, count = cloud.shape
    state, value = space[:n], space[n:]
    for t in range(trials):
        seen = platforms[t if platforms.shape[0] > 1 else 0]
        for j in range(count):
            for i in range(n):
                state[i] = cloud[t, i, j]
            failed = evaluate(parts, parameters, state, seen, value, none)
            if failed >= 0:
                return (t * count + j) * 256 + failed
            for i in range(chosen.shape[0]):
                out[t, i, j] = wrapped(measured[t, i] - value[chosen[i]], moduli[i])
    return -1


@compiled("void(float64[:,:,::1],float64[:,::1],float64[:,:,::1],float64[:,:,::1],float64[:,::1])")
def likelihoods(residual: Any, missing: Any, weight: Any, white: Any, out: Any) -> None:
    """Write whitened residuals W r (trials, m, N) and -|W r|^2 / 2 (trials, N).

    Rows of `missing` (trials, m) that are not 0 are left out. A particle for which the model has no value has the
    logarithm -inf and whitened residuals of 0. `weight` W is (1 or trials, m, m).
    """
    trials, m, count = residual.shape
    for t in range(trials):
        own = weight[t if weight.shape[0] > 1 else 0]
        for begin in range(0, count, _BLOCK):
            end = min(begin + _BLOCK, count)
            logarithm = out[t, begin:end]
            for j in range(logarithm.shape[0]):
                logarithm[j] = 0.0
            for i in range(m):
                row = white[t, i, begin:end]
                for j in range(row.shape[0]):
                    row[j] = 0.0
                for k in range(m):
                    if missing[t, i] + missing[t, k] == 0.0 and own[i, k] != 0.0:
                        _add(own[i, k], residual[t, k, begin:end], row)
                for j in range(row.shape[0]):
                    logarithm[j] += row[j] * row[j]
            for j in range(logarithm.shape[0]):
                logarithm[j] *= -0.5
            for j in range(logarithm.shape[0]):
                if not math.isfinite(logarithm[j]):
                    logarithm[j] = -math.inf
                    for i in range(m):
                        white[t, i, begin + j] = 0.0


@compiled("void(float64[:,:,::1],float64[:,::1],float64[:,::1],float64[:,::1],float64[:,:,::1])")
def moments(cloud: Any, weight: Any, space: Any, mean: Any, covariance: Any) -> None:
    """Write mean and covariance of clouds (trials, n, N) with weights (trials, N) that sum to 1, or (0, N): all alike.

    `space` is (n + 1, 512).
    """
    trials, n, count = cloud.shape
    alike = weight.shape[0] == 0
    for t in range(trials):
        for i in range(n):
            mean[t, i] = _total(cloud[t, i]) / count if alike else _product(cloud[t, i], weight[t])
            for k in range(n):
                covariance[t, i, k] = 0.0
        for begin in range(0, count, _BLOCK):
            size = min(_BLOCK, count - begin)
            root = space[n, :size]
            if not alike:
                share = weight[t, begin : begin + size]
                for j in range(size):
                    root[j] = math.sqrt(share[j])
            for i in range(n):
                here = mean[t, i]
                row, offset = cloud[t, i, begin : begin + size], space[i, :size]
                for j in range(size):
                    offset[j] = row[j] - here
                if not alike:
                    for j in range(size):
                        offset[j] *= root[j]
                for k in range(i + 1):
                    covariance[t, i, k] += _product(offset, space[k, :size])
        for i in range(n):
            for k in range(i + 1):
                if alike:
                    covariance[t, i, k] /= count
                covariance[t, k, i] = covariance[t, i, k]


@inlined
def _add(factor: float, one: Any, row: Any) -> None:
    for j in range(row.shape[0]):
        row[j] += factor * one[j]


@summing
def _total(one: Any) -> float:
    total = 0.0
    for j in range(one.shape[0]):
        total += one[j]
    return total


@summing
def _product(one: Any, other: Any) -> float:
    total = 0.0
    for j in range(one.shape[0]):
        total += one[j] * other[j]
    return total
