"""Systematic resampling, and the copying of the particles that were chosen."""

from __future__ import annotations

from typing import Any

from quietfix.systems.kernels.compiling import compiled

__all__ = ["gather", "parents", "systematic"]


@compiled("void(float64[:,::1],float64[:,::1],int64[:,::1])")
def systematic(weights: Any, uniform: Any, counts: Any) -> None:
    """Write how often each particle is taken; `weights` (rows, N), `uniform` (1 or rows, 1).

    See `quietfix.systems.filters.particle.resampling.systematic`.
    """
    rows, count = weights.shape
    for t in range(rows):
        own = uniform[t if uniform.shape[0] > 1 else 0, 0]
        whole = 0.0
        for j in range(count):
            whole += weights[t, j]
        running, before = 0.0, 0
        for j in range(count):
            running += weights[t, j]
            edge = count * (running / whole)
            below = int(edge)
            # k + u < edge, without the rounding of edge - u, which could give a particle without weight a point
            points = below + 1 if own < edge - below else below
            counts[t, j] = points - before
            before = points


@compiled("void(int64[:,::1],int64[:,::1])")
def parents(counts: Any, chosen: Any) -> None:
    """Write which particle each new one comes from, rising; both (rows, N), `counts` sum to N."""
    rows, count = counts.shape
    for t in range(rows):
        for k in range(count):
            chosen[t, k] = 0
        place = 0
        for j in range(count):
            # without a branch that depends on the counts: whoever has none is overwritten by the next
            chosen[t, min(place, count - 1)] = j if place < count else chosen[t, count - 1]
            place += counts[t, j]
        last = 0
        for k in range(count):
            last = max(last, chosen[t, k])
            chosen[t, k] = last


@compiled("void(float64[:,:,::1],float64[:,::1],int64[:,::1],float64[:,:,::1],float64[:,::1])")
def gather(cloud: Any, ancestor: Any, chosen: Any, out: Any, out_ancestor: Any) -> None:
    """Copy the chosen particles (trials, n, N) and their ancestors (trials, N); `chosen` are numbers < N."""
    trials, n, count = cloud.shape
    for t in range(trials):
        for i in range(n):
            for j in range(count):
                out[t, i, j] = cloud[t, i, chosen[t, j]]
        for j in range(count):
            out_ancestor[t, j] = ancestor[t, chosen[t, j]]
