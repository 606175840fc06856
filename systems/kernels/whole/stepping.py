"""A whole step, called from Python."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.loading import ready
from quietfix.systems.kernels.sharing import pieces, side_by_side
from quietfix.systems.kernels.updating import plain, workspace

if TYPE_CHECKING:
    from quietfix.systems.kernels.equations import Program

__all__ = ["linear"]

Array = NDArray[np.float64]

_EACH = 4.0  # us that a trial takes, about


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
    given = (
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
    )
    cut = pieces(trials, _EACH)
    if len(cut) > 1:
        return _shared(state, given, cut, workspace(n, m, program.rows))
    space = np.empty(trials * n * (n + 1) + n * n + workspace(n, m, program.rows))
    failed: int = _loaded()(state, *given, space)
    return failed == 0


def _shared(state: Array, given: Sequence[Any], cut: Sequence[slice], room: int) -> bool:
    """Do the same in pieces: there, what belongs to a trial is not in one place of the state."""
    phi, process, measurement, platforms, noise, *rest = given
    trials, m = measurement.shape
    n = phi.shape[-1]
    ends = np.cumsum([trials * n, trials * n * n, trials * m, trials])
    mean, covariance, innovation, nis, used = np.split(state[: ends[-1] + trials], ends)
    out = mean.reshape(trials, n), covariance.reshape(trials, n, n), innovation.reshape(trials, m), nis, used
    predict, update = ready("predicting:by_matrix"), ready("extended:update")

    def of(array: Array, piece: slice) -> Array:
        return array if array.shape[0] == 1 else array[piece]

    def step(piece: slice) -> int:
        own = [array[piece] for array in out]
        prior = np.empty_like(own[0]), np.empty_like(own[1])
        predict(own[0], own[1], of(phi, piece), of(process, piece), np.empty((n, n)), *prior)
        seen = measurement[piece], of(platforms, piece), of(noise, piece)
        answer: int = update(*prior, *seen, *rest, np.empty(room), *own)
        return answer

    return not any(side_by_side([(step, (piece,)) for piece in cut]))
