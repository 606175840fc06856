"""Prediction by matrices and update, from an estimator's state to its next one."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.calling import UPDATE, caller
from quietfix.systems.kernels.compiling import compiled, inlined
from quietfix.systems.kernels.predicting import BY_MATRIX
from quietfix.systems.kernels.recovery.surprise import followed

__all__ = ["step"]

_predict, _update = caller(BY_MATRIX), caller(UPDATE)


@compiled(
    "int64(float64[::1],int64,int64,float64,float64[:,:,::1],float64[:,:,::1],float64[::1],float64[::1],"
    "int64[::1],int64[::1],float64[:,:,::1],int64[:,::1],int64[::1],float64[::1],float64[::1],float64[::1],"
    "float64[::1],float64[::1])"
)
def step(
    state: Any,
    begin: int,
    end: int,
    now: float,
    phi: Any,
    process: Any,
    stream: Any,
    platforms: Any,
    sizes: Any,
    rows: Any,
    noise: Any,
    parts: Any,
    chosen: Any,
    parameters: Any,
    moduli: Any,
    settings: Any,
    rule: Any,
    space: Any,
) -> int:
    """Make of the state of trials `begin` to `end` the next one; return 0, or 1 where another way is to be gone.

    The state is, of all trials, means, covariances, innovations, NIS, rows used, which have started, sums of surprise,
    and how often each began again; then when all began, the time that it holds for, and whether its measurement is
    used. `stream` and `platforms` are what the ports carry, `rows` those of a measurement that are used, `rule` what
    `quietfix.systems.kernels.recovery.surprise.follow` is given; `sizes` are the addresses of prediction and update,
    trials, trials of the platforms, platforms. `space` has room for means, covariances and measurements of these
    trials, one matrix, and what the update works in. What it makes of a state is spoiled where it does not return 0.
    """
    n, m, trials, count = phi.shape[1], chosen.shape[0], sizes[2], end - begin
    a = trials * n
    b = a + a * n
    c = b + trials * m
    started, watch = state[c + 2 * trials : c + 3 * trials], state[c + 3 * trials : c + 4 * trials]
    mean = state[:a].reshape(trials, n)[begin:end]
    covariance = state[a:b].reshape(trials, n, n)[begin:end]
    d = count * n
    e = d + d * n
    f = e + count * m
    prior, spread = space[:d].reshape(count, n), space[d:e].reshape(count, n, n)
    measured, square = space[e:f].reshape(count, m), space[f : f + n * n].reshape(n, n)
    if not _complete(mean, covariance, started[begin:end], stream, begin, stream.shape[0] // trials, rows, measured):
        return 1
    all_seen = platforms.reshape(sizes[3], sizes[4], 6)
    seen = all_seen[begin:end] if sizes[3] > 1 else all_seen
    nis, used = state[c + begin : c + end], state[c + trials + begin : c + trials + end]
    own_phi = phi[begin:end] if phi.shape[0] > 1 else phi
    own_process = process[begin:end] if process.shape[0] > 1 else process
    _predict(sizes[0], (mean, covariance, own_phi, own_process, square, prior, spread))
    innovation = state[b:c].reshape(trials, m)[begin:end]
    given = prior, spread, measured, seen, noise, parts, chosen, parameters, moduli, settings
    if _update(sizes[1], (*given, space[f + n * n :], mean, covariance, innovation, nis, used)) != 0:
        return 1
    for t in range(count):
        before = watch[begin + t]
        watch[begin + t] = followed(nis[t], used[t], rule[0], rule[1], rule[2], rule[3], before)
    state[state.shape[0] - 2], state[state.shape[0] - 1] = now, 1.0
    return 0


@inlined
def _complete(
    mean: Any, covariance: Any, started: Any, stream: Any, begin: int, width: int, rows: Any, measured: Any
) -> bool:
    """Write the rows that are used; return whether all trials have started, and all of it is finite."""
    count, n = mean.shape
    for t in range(count):
        if started[t] != 1.0:
            return False
        nought = 0.0  # NaN where one is not finite
        for i in range(n):
            nought += mean[t, i] - mean[t, i]
            for j in range(n):
                nought += covariance[t, i, j] - covariance[t, i, j]
        for i in range(rows.shape[0]):
            value = stream[(begin + t) * width + rows[i]]
            nought += value - value
            measured[t, i] = value
        if not math.isfinite(nought):
            return False
    return True
