"""Prediction by matrices and (iterated) extended Kalman update, from a block's state to its next one."""

from __future__ import annotations

from typing import Any

from quietfix.systems.kernels.compiling import compiled
from quietfix.systems.kernels.extended import update
from quietfix.systems.kernels.predicting import by_matrix

__all__ = ["extended"]


@compiled(
    "int64(float64[::1],float64[:,:,::1],float64[:,:,::1],float64[:,::1],float64[:,:,::1],float64[:,:,::1],"
    "int64[:,::1],int64[::1],float64[::1],float64[::1],int64,float64,float64[::1])"
)
def extended(
    state: Any,
    phi: Any,
    process: Any,
    measurement: Any,
    platforms: Any,
    noise: Any,
    parts: Any,
    chosen: Any,
    parameters: Any,
    moduli: Any,
    iterations: int,
    tolerance: float,
    space: Any,
) -> int:
    """Make of the state of all trials the next one; return 0, or what `quietfix.systems.kernels.extended.update` does.

    The state is the means, the covariances, and room for innovations, NIS and rows used. `space` has room for means,
    covariances and one matrix more than an update.
    """
    trials, m = measurement.shape
    n = phi.shape[1]
    a = trials * n
    b = a + a * n
    c = b + trials * m
    mean, covariance = state[:a].reshape(trials, n), state[a:b].reshape(trials, n, n)
    prior, spread = space[:a].reshape(trials, n), space[a:b].reshape(trials, n, n)
    by_matrix(mean, covariance, phi, process, space[b : b + n * n].reshape(n, n), prior, spread)
    return update(
        prior,
        spread,
        measurement,
        platforms,
        noise,
        parts,
        chosen,
        parameters,
        moduli,
        iterations,
        tolerance,
        space[b + n * n :],
        mean,
        covariance,
        state[b:c].reshape(trials, m),
        state[c : c + trials],
        state[c + trials : c + 2 * trials],
    )
