"""Systematic resampling, and the copying of the particles that were chosen."""

from __future__ import annotations

from typing import Any

from quietfix.systems.kernels.compiling import compiled, inlined
from quietfix.systems.kernels.particles.normals import draw

__all__ = ["carry", "gather", "parents", "renew", "systematic"]

_BLOCK = 512  # particles at a time, so that a block stays in the nearest cache


@compiled("void(float64[:,::1],float64[:,::1],int64[:,::1])")
def systematic(weights: Any, uniform: Any, counts: Any) -> None:
    """Write how often each particle is taken; `weights` (rows, N), `uniform` (1 or rows, 1).

    See `quietfix.systems.filters.particle.resampling.systematic`.
    """
    for t in range(weights.shape[0]):
        _count(weights[t], uniform[t if uniform.shape[0] > 1 else 0, 0], counts[t])


@inlined
def _count(weights: Any, own: float, counts: Any) -> None:
    count = weights.shape[0]
    whole = 0.0
    for j in range(count):
        whole += weights[j]
    running, before = 0.0, 0
    for j in range(count):
        running += weights[j]
        edge = count * (running / whole)
        below = int(edge)
        # k + u < edge, without the rounding of edge - u, which could give a particle without weight a point
        points = below + 1 if own < edge - below else below
        counts[j] = points - before
        before = points


@compiled("void(int64[:,::1],int64[:,::1])")
def parents(counts: Any, chosen: Any) -> None:
    """Write which particle each new one comes from, rising; both (rows, N), `counts` sum to N."""
    for t in range(counts.shape[0]):
        _parents(counts[t], chosen[t])


@inlined
def _parents(counts: Any, chosen: Any) -> None:
    count = counts.shape[0]
    for k in range(count):
        chosen[k] = 0
    place = 0
    for j in range(count):
        # without a branch that depends on the counts: whoever has none is overwritten by the next
        chosen[min(place, count - 1)] = j if place < count else chosen[count - 1]
        place += counts[j]
    last = 0
    for k in range(count):
        last = max(last, chosen[k])
        chosen[k] = last


@compiled("void(float64[:,:,::1],float64[:,::1],int64[:,::1],float64[:,:,::1],float64[:,::1])")
def gather(cloud: Any, ancestor: Any, chosen: Any, out: Any, out_ancestor: Any) -> None:
    """Copy the chosen particles (trials, n, N) and their ancestors (trials, N); `chosen` are numbers < N."""
    for t in range(cloud.shape[0]):
        _gather(cloud[t], chosen[t], out[t])
        _take(ancestor[t], chosen[t], out_ancestor[t])


@inlined
def _gather(cloud: Any, chosen: Any, out: Any) -> None:
    for i in range(cloud.shape[0]):
        _take(cloud[i], chosen, out[i])


@inlined
def _take(row: Any, chosen: Any, out: Any) -> None:
    for j in range(chosen.shape[0]):
        out[j] = row[chosen[j]]


@compiled(
    "void(float64[:,:,::1],float64[:,::1],int64[::1],float64[:,::1],float64[:,::1],int64[:,::1],float64[:,::1],"
    "float64[:,:,::1],float64,uint64[:,::1],boolean,int64[:,::1],float64[:,:,::1],float64[:,:,::1],float64[:,::1],"
    "float64[:,::1])"
)
def renew(
    cloud: Any,
    ancestor: Any,
    which: Any,
    weight: Any,
    uniform: Any,
    given: Any,
    mean: Any,
    root: Any,
    shrink: float,
    state: Any,
    apart: bool,
    counts: Any,
    space: Any,
    out: Any,
    out_ancestor: Any,
    out_logarithm: Any,
) -> None:
    """Write the resampled clouds of `which` trials into others, the same unless `apart`, and ancestors, equal weights.

    From `weight` (k, N) and `uniform` (k, 1) by the systematic scheme, or with the `given` counts (k, N). Where there
    are states (k, 4) of generators, a particle is drawn from a kernel: s x + (1 - s) mean + L e, `shrink` s, `root` L
    (k, n, n); see `quietfix.systems.filters.particle.kernel.shrunk_kernel`. `counts` is (2, N), `space` (2, n, N).
    """
    _, n, count = cloud.shape
    number, chosen, kept, white = counts[0], counts[1], space[0], space[1]
    for k in range(which.shape[0]):
        t = which[k]
        if given.shape[0] > 0:
            _parents(given[k], chosen)
        else:
            _count(weight[k], uniform[k, 0], number)
            _parents(number, chosen)
        if apart:
            _take(ancestor[t], chosen, out_ancestor[t])
        else:
            _take(ancestor[t], chosen, white[0])
            _copy(white[0], out_ancestor[t])
        for j in range(count):
            out_logarithm[t, j] = 0.0
        if apart and state.shape[0] == 0:
            _gather(cloud[t], chosen, out[t])
            continue
        _gather(cloud[t], chosen, kept)
        if state.shape[0] > 0:
            draw(state[k], white.reshape(n * count))
            _shake(kept, mean[k], root[k], shrink, white, out[t])
        else:
            for i in range(n):
                _copy(kept[i], out[t, i])


@inlined
def _copy(row: Any, out: Any) -> None:
    for j in range(row.shape[0]):
        out[j] = row[j]


@compiled("void(float64[:,:,::1],float64[:,::1],int64[::1],float64[:,:,::1],float64[:,::1])")
def carry(cloud: Any, ancestor: Any, which: Any, out: Any, out_ancestor: Any) -> None:
    """Copy the clouds of `which` trials and their ancestors to the same trials of others."""
    for k in range(which.shape[0]):
        t = which[k]
        for i in range(cloud.shape[1]):
            _copy(cloud[t, i], out[t, i])
        _copy(ancestor[t], out_ancestor[t])


@inlined
def _shake(cloud: Any, mean: Any, root: Any, shrink: float, white: Any, out: Any) -> None:
    """Write s x + (1 - s) mean + L e of a cloud (n, N)."""
    n, count = cloud.shape
    for begin in range(0, count, _BLOCK):
        end = min(begin + _BLOCK, count)
        for i in range(n):
            start, row, here = (1.0 - shrink) * mean[i], out[i, begin:end], cloud[i, begin:end]
            for j in range(row.shape[0]):
                row[j] = start + shrink * here[j]
            for k in range(i + 1):
                factor, one = root[i, k], white[k, begin:end]
                for j in range(row.shape[0]):
                    row[j] += factor * one[j]
