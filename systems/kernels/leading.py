"""A kernel over the leading axes of an array: one state after the other."""

from __future__ import annotations

from typing import Any

from quietfix.systems.kernels.compiling import compiled
from quietfix.systems.kernels.rows import evaluate

__all__ = ["over_axes"]


@compiled("int64(float64[:,:,:],float64[:,:,:,:],int64[:,::1],float64[::1],float64[:,:,::1],float64[:,:,:,::1])")
def over_axes(states: Any, platforms: Any, parts: Any, parameters: Any, values: Any, jacobians: Any) -> int:
    """Evaluate states (a, b, n) seen from platforms (1 or a, 1 or b, p, 6); `jacobians` without a row: values alone.

    Returns
    -------
    int
        -1, or (state 256 + part) of a kernel that raised.
    """
    for i in range(states.shape[0]):
        for j in range(states.shape[1]):
            seen = platforms[i if platforms.shape[0] > 1 else 0, j if platforms.shape[1] > 1 else 0]
            failed = evaluate(parts, parameters, states[i, j], seen, values[i, j], jacobians[i, j])
            if failed >= 0:
                return (i * states.shape[1] + j) * 256 + failed
    return -1
