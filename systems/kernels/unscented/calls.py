"""The compiled unscented filter, called with arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import Program, Step
from quietfix.systems.kernels.loading import ready
from quietfix.systems.kernels.sharing import Parts, call
from quietfix.systems.kernels.updating import NO_INPUT, Update, by_update, plain, settings

__all__ = ["UNSCENTED", "predicted", "updated"]

Array = NDArray[np.float64]
Weights = tuple[float, float, float]

_PREDICT = Parts((0, 1, 2, 10, 11), 9, each=6.0, unit=256, good=-1)


def updated(
    mean: Array,
    covariance: Array,
    measurement: Array,
    platforms: Array,
    noise: Array,
    program: Program,
    weights: Weights,
) -> tuple[Array, Array, Array, Array, Array]:
    """Return mean, covariance, innovation, NIS and rows used of the unscented Kalman update.

    Arguments as of `quietfix.systems.filters.gaussian.GaussianFilter.update`; `noise` is R (m, m) or (trials, m, m),
    `weights` how many columns of the root a point lies off, the weight of an outer point, and that of the centre in a
    covariance.

    Raises
    ------
    ValueError
        Where R is not positive definite, platforms are too few, or a user's kernel raised.
    """
    given = mean, covariance, measurement, platforms, noise
    return by_update(UNSCENTED, given, program, settings(*weights))


def _room(n: int, m: int, rows: int) -> int:
    return 2 * n + 5 * m + (2 * n + 1) * (n + rows) + 4 * n * n + 3 * n * m + 6 * m * m


UNSCENTED = Update("unscented.update:update", _room, each=6.0, looped=True)


def predicted(mean: Array, covariance: Array, step: Step, held: Array | None, weights: Weights) -> tuple[Array, Array]:
    """Return mean and covariance after a compiled step of a motion, whose input is `held` (trials, k).

    Raises
    ------
    ValueError
        Where a user's kernel raised.
    """
    states, spread = plain(mean), plain(covariance)
    n = states.shape[-1]
    inputs = NO_INPUT if held is None else plain(held[..., None, :].reshape(-1, 1, held.shape[-1]))
    moved, out = np.empty(states.shape), np.empty(spread.shape)
    given = step.parts, step.parameters, step.noise
    arguments = states, spread, inputs, *given, *weights, np.empty((7, n, n)), moved, out
    code = call(ready("unscented.prediction:predict"), arguments, states.shape[0], _PREDICT)
    if code >= 0:
        raise ValueError(f"motion: its kernel raised for a state {states[code >> 8].tolist()}")
    return moved, out
