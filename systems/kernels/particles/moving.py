"""Clouds moved and shaken: every particle by a matrix or a motion's kernel, and by its own random numbers."""

from __future__ import annotations

from typing import Any

from quietfix.systems.kernels.compiling import compiled, inlined
from quietfix.systems.kernels.particles.loops import call_over
from quietfix.systems.kernels.particles.normals import draw

__all__ = ["by_kernel", "by_matrix"]

_BLOCK = 512  # particles at a time, so that a block stays in the nearest cache


@compiled(
    "void(float64[:,:,::1],float64[:,:,::1],float64[:,::1],float64[:,:,::1],float64[:,:,::1],uint64[:,::1],"
    "float64[:,:,::1])"
)
def by_matrix(cloud: Any, phi: Any, offset: Any, root: Any, white: Any, state: Any, out: Any) -> None:
    """Write Phi x + offset + L e for clouds (trials, n, N), which `out` shares no memory with.

    `phi` (1 or trials, n, n), `offset` (trials, n), `root` L (1 or trials, n, r), `white` e (trials, r, N), or
    (1, r, N) where each trial's are drawn into it from the state (trials, 4) of its generator.
    """
    trials, n, count = cloud.shape
    for t in range(trials):
        own, random = phi[t if phi.shape[0] > 1 else 0], white[_drawn(t, white, state)]
        for begin in range(0, count, _BLOCK):
            end = min(begin + _BLOCK, count)
            for i in range(n):
                start, row, factor, one = offset[t, i], out[t, i, begin:end], own[i, i], cloud[t, i, begin:end]
                for j in range(row.shape[0]):
                    row[j] = start + factor * one[j]
                for k in range(n):
                    if k != i and own[i, k] != 0.0:
                        _add(own[i, k], cloud[t, k, begin:end], row)
            _shake(t, root, random, begin, end, out)


@inlined
def _drawn(t: int, white: Any, state: Any) -> int:
    """Draw a trial's normal numbers where there are states; return where they are."""
    if state.shape[0] == 0:
        return t
    draw(state[t], white[0].reshape(white.shape[1] * white.shape[2]))
    return 0


@compiled(
    "int64(float64[:,:,::1],float64[:,:,::1],int64,float64[::1],float64[:,:,::1],float64[:,:,::1],uint64[:,::1],"
    "float64[:,:,::1])"
)
def by_kernel(cloud: Any, inputs: Any, loop: int, parameters: Any, root: Any, white: Any, state: Any, out: Any) -> int:
    """Send every particle through a motion's kernel, and add L e; arguments as of `by_matrix`.

    `inputs` (1 or trials, 1, k) stand where a measurement's kernel has platforms; `loop` is the address of the kernel's
    loop.

    Returns
    -------
    int
        -1, or the trial in which the kernel raised.
    """
    trials, _, count = cloud.shape
    for t in range(trials):
        held, random = inputs[t if inputs.shape[0] > 1 else 0], white[_drawn(t, white, state)]
        for begin in range(0, count, _BLOCK):
            end = min(begin + _BLOCK, count)
            if call_over(loop, cloud[t], begin, end, held, parameters, out[t], 0, begin):
                return t
            _shake(t, root, random, begin, end, out)
    return -1


@inlined
def _shake(t: int, root: Any, white: Any, begin: int, end: int, out: Any) -> None:
    own = root[t if root.shape[0] > 1 else 0]
    for i in range(own.shape[0]):
        for k in range(own.shape[1]):
            if own[i, k] != 0.0:
                _add(own[i, k], white[k, begin:end], out[t, i, begin:end])


@inlined
def _add(factor: float, one: Any, row: Any) -> None:
    for j in range(row.shape[0]):
        row[j] += factor * one[j]
