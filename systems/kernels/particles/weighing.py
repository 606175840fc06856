"""What a measurement says of every particle, and the moments of a weighted cloud."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.compiling import compiled, inlined, summing
from quietfix.systems.kernels.particles.loops import call_over
from quietfix.systems.kernels.particles.sums import largest, product, total
from quietfix.systems.kernels.rows import wrapped

__all__ = ["likelihoods", "look", "moments", "residuals", "spread", "told"]

_BLOCK = 512  # particles at a time, so that a block stays in the nearest cache


@compiled(
    "int64(float64[:,:,::1],float64[:,::1],float64[:,:,::1],int64[:,::1],int64[::1],int64[::1],float64[::1],"
    "float64[::1],float64[:,::1],float64[:,:,::1],int64[:,::1])"
)
def residuals(
    cloud: Any,
    measured: Any,
    platforms: Any,
    parts: Any,
    loops: Any,
    chosen: Any,
    parameters: Any,
    moduli: Any,
    space: Any,
    out: Any,
    there: Any,
) -> int:
    """Write measured (trials, m) minus predicted for clouds (trials, n, N), shape (trials, m, N).

    `platforms` hold one for all trials or one for each; `loops` are the addresses of the kernels' loops; `space` has
    room for all rows of the kernels, (rows, 512); `there` (trials, m) becomes how many of each row are finite.

    Returns
    -------
    int
        -1, or 256 trial + part where a kernel raised.
    """
    trials, _, count = cloud.shape
    for t in range(trials):
        seen = platforms[t if platforms.shape[0] > 1 else 0]
        for i in range(chosen.shape[0]):
            there[t, i] = 0
        for begin in range(0, count, _BLOCK):
            end = min(begin + _BLOCK, count)
            failed = _predict(cloud[t], seen, parts, loops, parameters, begin, end, space)
            if failed >= 0:
                return t * 256 + failed
            for i in range(chosen.shape[0]):
                row = out[t, i, begin:end]
                _differ(measured[t, i], space[chosen[i], : end - begin], moduli[i], row)
                there[t, i] += _finite(row)
    return -1


@compiled(
    "int64(float64[:,:,::1],int64[::1],float64[:,::1],float64[:,:,::1],int64[:,::1],int64[::1],int64[::1],"
    "float64[::1],float64[::1],float64[:,::1],float64[:,:,::1],float64[:,::1],float64[:,::1],float64[::1])"
)
def told(
    cloud: Any,
    which: Any,
    measured: Any,
    platforms: Any,
    parts: Any,
    loops: Any,
    chosen: Any,
    parameters: Any,
    moduli: Any,
    missing: Any,
    weight: Any,
    space: Any,
    out: Any,
    highest: Any,
) -> int:
    """Write what `look` does of the clouds of `which` trials, from what is measured of all; `space` as of `residuals`.

    `space` has m rows more. Returns what `residuals` does.
    """
    count, m = cloud.shape[2], chosen.shape[0]
    rows = space.shape[0] - 2 * m
    for k in range(which.shape[0]):
        t = which[k]
        seen, own = platforms[t if platforms.shape[0] > 1 else 0], weight[t if weight.shape[0] > 1 else 0]
        highest[k] = -math.inf
        for begin in range(0, count, _BLOCK):
            end = min(begin + _BLOCK, count)
            failed = _predict(cloud[t], seen, parts, loops, parameters, begin, end, space)
            if failed >= 0:
                return t * 256 + failed
            residual, white = space[rows : rows + m, : end - begin], space[rows + m :, : end - begin]
            for i in range(m):
                _differ(measured[t, i], space[chosen[i], : end - begin], moduli[i], residual[i])
            highest[k] = max(highest[k], _whiten(residual, missing[t], own, white, out[k, begin:end]))
    return -1


@inlined
def _predict(
    cloud: Any, platforms: Any, parts: Any, loops: Any, parameters: Any, begin: int, end: int, space: Any
) -> int:
    for k in range(parts.shape[0]):
        given = parameters[parts[k, 3] : parts[k, 4]]
        if call_over(loops[k], cloud, begin, end, platforms, given, space, parts[k, 1], 0):
            return k
    return -1


@inlined
def _differ(measured: float, predicted: Any, modulus: float, out: Any) -> None:
    """Write measured minus predicted, wrapped; see `quietfix.systems.kernels.rows.wrapped`."""
    half, within = 0.5 * modulus, True
    for j in range(out.shape[0]):
        out[j] = measured - predicted[j]
    if modulus == 0.0:
        return
    for j in range(out.shape[0]):
        # as nearly all are: the remainder, which is slow, is the number itself; NaN, too
        within &= not (out[j] + half < 0.0 or out[j] + half >= modulus)
    if within:
        for j in range(out.shape[0]):
            out[j] = (out[j] + half) - half
    else:
        for j in range(out.shape[0]):
            out[j] = wrapped(out[j], modulus)


@inlined
def _finite(row: Any) -> int:
    found = 0
    for j in range(row.shape[0]):
        found += 1 if math.fabs(row[j]) < math.inf else 0
    return found


@compiled(
    "void(float64[:,:,::1],float64[:,::1],float64[:,:,::1],float64[:,::1],boolean[::1],float64[:,::1],float64[:,::1],"
    "float64[:,::1],float64[::1],float64[:,::1],float64[:,::1],float64[:,:,::1])"
)
def look(
    residual: Any,
    missing: Any,
    weight: Any,
    share: Any,
    alike: Any,
    white: Any,
    space: Any,
    out: Any,
    highest: Any,
    value: Any,
    mean: Any,
    covariance: Any,
) -> None:
    """Write -|W r|^2 / 2 (trials, N) of residuals r (trials, m, N), the largest, mean and covariance of W r, mean of r.

    Rows of `missing` (trials, m) that are not 0 are left out. A particle for which the model has no value has the
    logarithm -inf and whitened residuals of 0; in the mean of r what is not finite is 0. `weight` W is (1 or trials, m,
    m), `share` (trials, N) the particles' weights, not read where they are `alike` (trials,). `white` has
    room for the whitened residuals of a trial, (m, N), `space` is (m + 1, 512).
    """
    trials, m, count = residual.shape
    for t in range(trials):
        own = weight[t if weight.shape[0] > 1 else 0]
        highest[t] = -math.inf
        for begin in range(0, count, _BLOCK):
            end = min(begin + _BLOCK, count)
            found = _whiten(residual[t, :, begin:end], missing[t], own, white[:, begin:end], out[t, begin:end])
            highest[t] = max(highest[t], found)
        for i in range(m):
            value[t, i] = _known(residual[t, i]) / count if alike[t] else _known_product(residual[t, i], share[t])
        spread(white, share[t], alike[t], space, mean[t], covariance[t])


@inlined
def _whiten(residual: Any, missing: Any, weight: Any, white: Any, logarithm: Any) -> float:
    """Write W r and -|W r|^2 / 2 of some particles; return the largest of the latter."""
    m = residual.shape[0]
    for j in range(logarithm.shape[0]):
        logarithm[j] = 0.0
    for i in range(m):
        row = white[i]
        for j in range(row.shape[0]):
            row[j] = 0.0
        for k in range(m):
            if missing[i] + missing[k] == 0.0 and weight[i, k] != 0.0:
                _add(weight[i, k], residual[k], row)
        for j in range(row.shape[0]):
            logarithm[j] += row[j] * row[j]
    for j in range(logarithm.shape[0]):
        logarithm[j] *= -0.5
    if _finite(logarithm) < logarithm.shape[0]:
        for j in range(logarithm.shape[0]):
            if not math.isfinite(logarithm[j]):
                logarithm[j] = -math.inf
                for i in range(m):
                    white[i, j] = 0.0
    return largest(logarithm)


@compiled("void(float64[:,:,::1],float64[:,::1],float64[:,:,::1],float64[:,:,::1],float64[:,::1])")
def likelihoods(residual: Any, missing: Any, weight: Any, white: Any, out: Any) -> None:
    """Write whitened residuals W r (trials, m, N) and -|W r|^2 / 2 (trials, N); see `look`."""
    for t in range(residual.shape[0]):
        _whiten(residual[t], missing[t], weight[t if weight.shape[0] > 1 else 0], white[t], out[t])


@compiled("void(float64[:,:,::1],float64[:,::1],float64[:,::1],float64[:,::1],float64[:,:,::1])")
def moments(cloud: Any, weight: Any, space: Any, mean: Any, covariance: Any) -> None:
    """Write mean and covariance of clouds (trials, n, N) with weights (trials, N) that sum to 1, or (0, N): all alike.

    `space` is (n + 1, 512).
    """
    alike = weight.shape[0] == 0
    for t in range(cloud.shape[0]):
        spread(cloud[t], weight[t], alike, space, mean[t], covariance[t])


@inlined
def spread(cloud: Any, weight: Any, alike: bool, space: Any, mean: Any, covariance: Any) -> None:
    """Write mean and covariance of a cloud (n, N) whose weights, unless they are all `alike`, sum to 1."""
    n, count = cloud.shape
    for i in range(n):
        mean[i] = total(cloud[i]) / count if alike else product(cloud[i], weight)
        for k in range(n):
            covariance[i, k] = 0.0
    for begin in range(0, count, _BLOCK):
        size = min(_BLOCK, count - begin)
        weighted, share = space[n, :size], weight[begin : begin + size]
        for i in range(n):
            here = mean[i]
            row, offset = cloud[i, begin : begin + size], space[i, :size]
            for j in range(size):
                offset[j] = row[j] - here
            if alike:
                for k in range(i + 1):
                    covariance[i, k] += product(offset, space[k, :size])
            else:
                for j in range(size):
                    weighted[j] = offset[j] * share[j]
                for k in range(i + 1):
                    covariance[i, k] += product(weighted, space[k, :size])
    for i in range(n):
        for k in range(i + 1):
            if alike:
                covariance[i, k] /= count
            covariance[k, i] = covariance[i, k]


@inlined
def _add(factor: float, one: Any, row: Any) -> None:
    for j in range(row.shape[0]):
        row[j] += factor * one[j]


@summing
def _known(one: Any) -> float:
    found = 0.0
    for j in range(one.shape[0]):
        found += one[j] if math.fabs(one[j]) < math.inf else 0.0
    return found


@summing
def _known_product(one: Any, other: Any) -> float:
    found = 0.0
    for j in range(one.shape[0]):
        found += (one[j] if math.fabs(one[j]) < math.inf else 0.0) * other[j]
    return found
