"""Clouds moved and shaken: every particle by a matrix or a motion's kernel, and by its own random numbers."""

from __future__ import annotations

from typing import Any

from quietfix.systems.kernels.calling import call_kernel
from quietfix.systems.kernels.compiling import compiled, inlined

__all__ = ["by_kernel", "by_matrix"]

_BLOCK = 512  # particles at a time, so that a block stays in the nearest cache


@compiled("void(float64[:,:,::1],float64[:,:,::1],float64[:,::1],float64[:,:,::1],float64[:,:,::1],float64[:,:,::1])")
def by_matrix(cloud: Any, phi: Any, offset: Any, root: Any, white: Any, out: Any) -> None:
    """Write Phi x + offset + L e for clouds (trials, n, N), which `out` shares no memory with.

    `phi` (1 or trials, n, n), `offset` (trials, n), `root` L (1 or trials, n, r), `white` e (trials, r, N).
    """
    trials, n, count = cloud.shape
    for t in range(trials):
        own = phi[t if phi.shape[0] > 1 else 0]
        for begin in range(0, count, _BLOCK):
            end = min(begin + _BLOCK, count)
            for i in range(n):
                start, row = offset[t, i], out[t, i, begin:end]
                for j in range(row.shape[0]):
                    row[j] = start
                for k in range(n):
                    if own[i, k] != 0.0:
                        _add(own[i, k], cloud[t, k, begin:end], row)
            _shake(t, root, white, begin, end, out)


@compiled(
    "int64(float64[:,:,::1],float64[:,:,::1],int64[:,::1],float64[::1],float64[:,:,::1],float64[:,:,::1],"
    "float64[:,::1],float64[:,:,::1])"
)
def by_kernel(cloud: Any, inputs: Any, parts: Any, parameters: Any, root: Any, white: Any, none: Any, out: Any) -> int:
    """Send every particle through a motion's kernel, and add L e; arguments as of `by_matrix`.

    `inputs` (1 or trials, 1, k) stand where a measurement's kernel has platforms; `none` is (0, n).

    Returns
    -------
    int
        -1, or the trial in which the kernel raised.
    """
    trials, _, count = cloud.shape
    given = parameters[parts[0, 3] : parts[0, 4]]
    for t in range(trials):
        held = inputs[t if inputs.shape[0] > 1 else 0]
        for begin in range(0, count, _BLOCK):
            end = min(begin + _BLOCK, count)
            for j in range(begin, end):
                if call_kernel(parts[0, 0], cloud[t, :, j], held, given, out[t, :, j], none):
                    return t
            _shake(t, root, white, begin, end, out)
    return -1


@inlined
def _shake(t: int, root: Any, white: Any, begin: int, end: int, out: Any) -> None:
    own = root[t if root.shape[0] > 1 else 0]
    for i in range(own.shape[0]):
        for k in range(own.shape[1]):
            if own[i, k] != 0.0:
                _add(own[i, k], white[t, k, begin:end], out[t, i, begin:end])


@inlined
def _add(factor: float, one: Any, row: Any) -> None:
    for j in range(row.shape[0]):
        row[j] += factor * one[j]
