"""The prediction of mean and covariance of many trials, one after the other."""

from __future__ import annotations

from typing import Any

from quietfix.systems.kernels.calling import call_kernel
from quietfix.systems.kernels.compiling import compiled, inlined
from quietfix.systems.kernels.matrices import times

__all__ = ["BY_MATRIX", "by_kernel", "by_matrix"]

BY_MATRIX = (
    "void(float64[:,::1],float64[:,:,::1],float64[:,:,::1],float64[:,:,::1],float64[:,::1],"
    "float64[:,::1],float64[:,:,::1])"
)


@inlined
def _spread(t: int, covariance: Any, phi: Any, noise: Any, half: Any, out: Any) -> None:
    r"""Write :math:`\Phi P \Phi^T + Q`, symmetric, for trial t.

    All is NaN where one element of P is not finite, however many zeros Phi has.
    """
    n = phi.shape[0]
    total = 0.0
    for i in range(n):
        nought = 0.0
        for j in range(n):
            nought += covariance[t, i, j] - covariance[t, i, j]  # 0, or NaN
        total += nought
    times(phi, covariance[t], half)
    for i in range(n):
        for j in range(i):
            half[i, j], half[j, i] = half[j, i], half[i, j]
    times(phi, half, out[t])
    for i in range(n):
        for j in range(i + 1):
            both = 0.5 * (out[t, i, j] + out[t, j, i])
            out[t, i, j] = both + noise[i, j] + total
            if j < i:
                out[t, j, i] = both + noise[j, i] + total


@compiled(BY_MATRIX)
def by_matrix(mean: Any, covariance: Any, phi: Any, noise: Any, space: Any, out_mean: Any, out_covariance: Any) -> None:
    """Predict by transition matrices and noise, both (1 or trials, n, n); `space` is (n, n).

    `out_mean` without a row: the means are predicted elsewhere.
    """
    n = phi.shape[1]
    for t in range(covariance.shape[0]):
        own = phi[t if phi.shape[0] > 1 else 0]
        _spread(t, covariance, own, noise[t if noise.shape[0] > 1 else 0], space, out_covariance)
        if out_mean.shape[0] > 0:
            for i in range(n):
                total = 0.0
                for k in range(n):
                    if own[i, k] != 0.0:
                        total += own[i, k] * mean[t, k]
                out_mean[t, i] = total


@compiled(
    "int64(float64[:,::1],float64[:,:,::1],float64[:,:,::1],int64[:,::1],float64[::1],float64[:,:,::1],"
    "float64[:,:,::1],float64[:,::1],float64[:,:,::1])"
)
def by_kernel(
    mean: Any,
    covariance: Any,
    inputs: Any,
    parts: Any,
    parameters: Any,
    noise: Any,
    space: Any,
    out_mean: Any,
    out_covariance: Any,
) -> int:
    """Predict by a motion's kernel, and by a second one that writes Q as its derivative, or by `noise` (1, n, n).

    `inputs` (1 or trials, 1, k) stand where a measurement's kernel has platforms; `space` is (3, n, n).

    Returns
    -------
    int
        -1, or (trial 256 + part) of a kernel that raised.
    """
    n = mean.shape[1]
    phi, q = space[0], space[1]
    for t in range(mean.shape[0]):
        given = inputs[t if inputs.shape[0] > 1 else 0]
        own = noise[0]
        for k in range(parts.shape[0]):
            square = phi if k == 0 else q
            for i in range(n):
                for j in range(n):
                    square[i, j] = 0.0
            value = out_mean[t] if k == 0 else space[2, 0]
            if call_kernel(parts[k, 0], mean[t], given, parameters[parts[k, 3] : parts[k, 4]], value, square):
                return t * 256 + k
            if k == 1:
                own = q
        _spread(t, covariance, phi, own, space[2], out_covariance)
    return -1
