"""A whole step, called from Python."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.loading import entry, ready
from quietfix.systems.kernels.sharing import pieces, side_by_side
from quietfix.systems.kernels.updating import Update, fit, plain

if TYPE_CHECKING:
    from quietfix.systems.kernels.equations import Program

__all__ = ["Linear", "Ports"]

Array = NDArray[np.float64]


class Ports(NamedTuple):
    """What an estimator is told.

    Attributes
    ----------
    trials, platform_trials, platforms : int
        As `quietfix.systems.estimators.wiring.Wiring` has them.
    rows : sequence of int
        Which of the rows on the port are those of the model.
    """

    trials: int
    platform_trials: int
    platforms: int
    rows: Sequence[int]


class Linear:
    """Prediction by a transition matrix, and update: what stays the same from step to step, and the step.

    It calls the very functions that `quietfix.systems.kernels.updating` calls one by one: every bit is theirs.

    Parameters
    ----------
    update : Update
    own : ndarray
        The filter's own `settings`.
    program : Program
        Of the measurement model.
    states : int
    noise : ndarray, shape (m, m)
        R.
    ports : Ports
    rule : sequence of float
        As of `quietfix.systems.kernels.recovery.surprise.follow`.

    Raises
    ------
    ValueError
        If platforms or states are too few for the model.
    """

    def __init__(
        self,
        update: Update,
        own: Array,
        program: Program,
        states: int,
        noise: Array,
        ports: Ports,
        rule: Sequence[float],
    ) -> None:
        fit(program, states, np.empty((ports.platform_trials, ports.platforms, 6)))
        self._trials, self._each, n = ports.trials, update.each, states
        addresses = entry("predicting:by_matrix"), entry(update.name)
        self._always = (
            np.array([*addresses, *ports[:3]], dtype=np.int64),
            np.array(ports.rows, dtype=np.int64),
            plain(noise[None]),
            *update.equations(program),
            own,
            np.array(rule, dtype=float),
        )
        m = len(ports.rows)
        self._room = n * n + update.room(n, m, program.rows), n + n * n + m
        self._code = ready("whole.linear:step")
        self._program = program  # its addresses are in use
        self._matrices: tuple[Array, Array] | None = None
        self._plain: tuple[Array, Array] | None = None

    def __call__(
        self, state: Array, now: float, matrices: tuple[Array, Array], stream: Array, platforms: Array
    ) -> bool:
        """Predict and update, in place; return whether it went well, else the state is spoiled.

        Parameters
        ----------
        state : ndarray
            Of all trials, see `quietfix.systems.kernels.whole.linear.step`.
        now : float
            The time [s] that the next state holds for.
        matrices : (ndarray, ndarray)
            Transition and process noise, (n, n).
        stream, platforms : ndarray
            What the ports carry.
        """
        if self._plain is None or self._matrices is None or not _are(matrices, self._matrices):
            n = matrices[0].shape[-1]
            self._plain = plain(matrices[0].reshape(-1, n, n)), plain(matrices[1].reshape(-1, n, n))
            self._matrices = matrices if not any(one.flags.writeable for one in matrices) else None
        given = now, *self._plain, stream, platforms, *self._always
        fixed, each = self._room
        cut = pieces(self._trials, self._each)
        if len(cut) == 1:
            answer: int = self._code(state, 0, self._trials, *given, np.empty(fixed + self._trials * each))
            return answer == 0
        calls = [(piece.start, piece.stop, *given) for piece in cut]
        room = [np.empty(fixed + (piece.stop - piece.start) * each) for piece in cut]
        return not any(side_by_side([(self._code, (state, *call, own)) for call, own in zip(calls, room, strict=True)]))


def _are(some: tuple[Array, Array], others: tuple[Array, Array]) -> bool:
    return some[0] is others[0] and some[1] is others[1]
