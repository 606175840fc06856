"""A whole step, called from Python."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.loading import ready
from quietfix.systems.kernels.updating import plain, workspace

if TYPE_CHECKING:
    from quietfix.systems.kernels.equations import Program

__all__ = ["linear"]

Array = NDArray[np.float64]


@cache
def _loaded() -> Any:
    for name in ("predicting:by_matrix", "extended:update"):  # what it calls comes first, with its own signature
        ready(name)
    return ready("whole.linear:extended")


def linear(
    state: Array,
    matrices: tuple[Array, Array],
    measurement: Array,
    platforms: Array,
    noise: Array,
    program: Program,
    rule: tuple[int, float],
) -> bool:
    """Predict by a transition matrix and update, in place; return whether it went well.

    It calls the very functions that `quietfix.systems.kernels.updating` calls one by one: every bit is theirs.

    Parameters
    ----------
    state : ndarray
        Of all trials, one after the other: means, covariances, innovations, NIS, rows used; spoiled if it fails.
    matrices : (ndarray, ndarray)
        Transition and process noise, (n, n) or (trials, n, n).
    measurement : ndarray, shape (trials, m)
    platforms : ndarray, shape (1 or trials, p, 6)
    noise : ndarray, shape (m, m)
        R.
    program : Program
        Of the measurement model.
    rule : (int, float)
        Linearisations at most, and the step below which there are no more.
    """
    trials, m = measurement.shape
    n = matrices[0].shape[-1]
    failed: int = _loaded()(
        state,
        plain(matrices[0].reshape(-1, n, n)),
        plain(matrices[1].reshape(-1, n, n)),
        plain(measurement),
        plain(platforms),
        plain(noise[None]),
        program.parts,
        program.chosen,
        program.parameters,
        program.moduli,
        *rule,
        np.empty(trials * n * (n + 1) + n * n + workspace(n, m, program.rows)),
    )
    return failed == 0
