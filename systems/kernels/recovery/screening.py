"""Innovations and their predicted spread, of many trials, one after the other."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.compiling import compiled
from quietfix.systems.kernels.rows import evaluate, mark_missing, residual

__all__ = ["screen"]

_RAISED = 3  # as quietfix.systems.kernels.extended.RAISED


@compiled(
    "int64(float64[:,::1],float64[:,:,::1],float64[:,::1],float64[:,:,::1],"
    "int64[:,::1],int64[::1],float64[::1],float64[::1],float64[::1],float64[:,::1],float64[:,:,::1])"
)
def screen(
    mean: Any,
    covariance: Any,
    measurement: Any,
    platforms: Any,
    parts: Any,
    chosen: Any,
    parameters: Any,
    moduli: Any,
    space: Any,
    innovation: Any,
    own: Any,
) -> int:
    r"""Write :math:`\nu = z - h(x)`, NaN in missing rows, and :math:`H P H^T`, 0 there; return what `update` does.

    `space` is room for n (2 m + full) + 2 m + full numbers, where the model's parts have `full` rows.
    """
    trials, n = mean.shape
    m, full = chosen.shape[0], parts[parts.shape[0] - 1, 2]
    difference, missing = space[:m], space[m : 2 * m]
    value = space[2 * m : 2 * m + full]
    begin = 2 * m + full
    jacobian = space[begin : begin + full * n].reshape(full, n)
    half = space[begin + full * n : begin + full * n + m * n].reshape(m, n)
    for t in range(trials):
        finite = True
        for j in range(n):
            finite = finite and math.isfinite(mean[t, j])
        if not finite:
            for i in range(m):
                innovation[t, i] = math.nan
                for j in range(m):
                    own[t, i, j] = 0.0
            continue
        failed = evaluate(parts, parameters, mean[t], platforms[t if platforms.shape[0] > 1 else 0], value, jacobian)
        if failed >= 0:
            return (t * 256 + failed) * 16 + _RAISED
        residual(t, measurement, value, chosen, moduli, difference)
        mark_missing(difference, jacobian, chosen, missing)
        for i in range(m):
            innovation[t, i] = math.nan if missing[i] > 0.0 else difference[i]
            for j in range(n):
                total = 0.0
                if missing[i] == 0.0:
                    for k in range(n):
                        total += jacobian[chosen[i], k] * covariance[t, k, j]
                half[i, j] = total
        for i in range(m):
            for j in range(i + 1):
                total = 0.0
                if missing[j] == 0.0:
                    for k in range(n):
                        total += half[i, k] * jacobian[chosen[j], k]
                own[t, i, j] = own[t, j, i] = total
    return 0
