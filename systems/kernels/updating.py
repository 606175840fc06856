"""Predictions and updates by compiled code: arrays in, arrays out, and in words what can go wrong."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import Program, Step
from quietfix.systems.kernels.loading import ready
from quietfix.systems.kernels.sharing import Parts, call

__all__ = [
    "EXTENDED",
    "NO_INPUT",
    "Update",
    "by_kernel",
    "by_matrix",
    "by_update",
    "extended",
    "fit",
    "plain",
    "raised",
    "settings",
]

Array = NDArray[np.float64]

NO_INPUT = np.zeros((1, 1, 1))
_BY_MATRIX = Parts((0, 1, 2, 3, 5, 6), 4, each=0.3)
_BY_KERNEL = Parts((0, 1, 2, 7, 8), 6, each=3.0, unit=256, good=-1)
_REASONS = {
    1: "the noise covariance must be finite in every row that is measured",
    2: "the noise covariance must be positive definite: rows are fully correlated",
}


class Update(NamedTuple):
    """A filter's compiled update.

    Attributes
    ----------
    name : str
        ``module:function``, of the signature `quietfix.systems.kernels.calling.UPDATE`.
    room : callable
        Returns in how many numbers it works, from numbers of states, of measured rows and of rows of all kernels.
    each : float
        About how long a trial takes [us].
    looped : bool
        Whether it asks the model for many states at once, by its kernels' loops.
    """

    name: str
    room: Callable[[int, int, int], int]
    each: float
    looped: bool = False

    def equations(self, program: Program) -> tuple[Any, ...]:
        """Return what it is given of a program."""
        parts = program.looped if self.looped else program.parts
        return parts, program.chosen, program.parameters, program.moduli

    @property
    def parts(self) -> Parts:
        """How its arguments are cut into pieces of trials."""
        return Parts((0, 1, 2, 3, 4, 11, 12, 13, 14, 15), 10, each=self.each, unit=4096)


@lru_cache
def settings(*numbers: float) -> Array:
    """Return a filter's own numbers as its compiled update takes them."""
    return np.array(numbers, dtype=float)


def plain(array: Array) -> Array:
    """Return an array as compiled code takes it: float64, in C order, writable; itself where it is so already."""
    flags = array.flags
    if flags.carray and array.dtype.char == "d":
        return array
    return np.array(array, dtype=np.float64, order="C")


def fit(program: Program, n: int, platforms: Array) -> None:
    """Raise where a kernel would read what is not there.

    Raises
    ------
    ValueError
        For a state or platforms (..., p, 6) that are too few.
    """
    needed = program.equations
    seen = platforms.shape[-2:]
    if n < needed.states or (needed.platforms and (seen[0] < needed.platforms or seen[1] < needed.coordinates)):
        raise ValueError(
            f"measurement model: {n} states and {seen} platforms and coordinates are not allowed; at least "
            f"{needed.states} and ({needed.platforms}, {needed.coordinates})"
        )


def extended(
    mean: Array,
    covariance: Array,
    measurement: Array,
    platforms: Array,
    noise: Array,
    program: Program,
    iterations: int,
    tolerance: float,
) -> tuple[Array, Array, Array, Array, Array]:
    """Return mean, covariance, innovation, NIS and rows used of the (iterated) extended Kalman update.

    Arguments as of `quietfix.systems.filters.gaussian.GaussianFilter.update`; `noise` is R (m, m) or (trials, m, m).

    Raises
    ------
    ValueError
        Where R is not positive definite, platforms are too few, or a user's kernel raised.
    """
    given = mean, covariance, measurement, platforms, noise
    return by_update(EXTENDED, given, program, settings(iterations, tolerance))


def by_update(
    update: Update, given: tuple[Array, Array, Array, Array, Array], program: Program, own: Array
) -> tuple[Array, Array, Array, Array, Array]:
    """Return what a compiled update makes of mean, covariance, measurement, platforms and noise; see `extended`.

    `own` are the filter's own `settings`.
    """
    mean, _, measurement, platforms, noise = given
    (trials, n), m = mean.shape, measurement.shape[-1]
    fit(program, n, platforms)
    if noise.ndim == 2:
        noise = noise[None]
    taken = [plain(array) for array in (*given[:4], noise)]
    out = np.empty((trials, n)), np.empty((trials, n, n)), np.empty((trials, m)), np.empty(trials), np.empty(trials)
    equations = update.equations(program)
    space = np.empty(update.room(n, m, program.rows))
    code = call(ready(update.name), (*taken, *equations, own, space, *out), trials, update.parts)
    if code:
        _fail(code, program, taken[0], taken[3])
    return out


def _room(n: int, m: int, rows: int) -> int:
    return 5 * n + 3 * m + rows * (n + 1) + 6 * n * n + m * n + 2 * m * m


EXTENDED = Update("extended:update", _room, each=4.0)
"""That of the extended and the iterated extended Kalman filter."""


def _fail(code: int, program: Program, states: Array, platforms: Array) -> None:
    """Raise what an update returned; see `quietfix.systems.kernels.extended.update`."""
    trial, part, reason = code >> 12, (code >> 4) & 255, code & 15
    if reason in _REASONS:
        raise ValueError(_REASONS[reason])
    raised(program, part, states[trial], platforms[trial if platforms.shape[0] > 1 else 0])


def raised(program: Program, part: int, state: Array, platforms: Array) -> None:
    """Say what a kernel raised: by calling its Python function where compiled code had to give up."""
    kernel: Any = program.equations.kernels[part]
    begin, end = program.parts[part, 3:5]
    rows = program.equations.sizes[part]
    name, reason = getattr(kernel, "__name__", str(kernel)), "it raised an exception"
    try:
        if not isinstance(kernel, str):  # one of ours that calls another one, which raised
            own, room = program.parameters[begin:end], (np.zeros(rows), np.zeros((rows, state.size)))
            getattr(kernel, "py_func", kernel)(state.copy(), platforms.copy(), own, *room)
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
    raise ValueError(f"kernel {name}: for a target at {state.tolist()}: {reason}")


def by_matrix(mean: Array | None, covariance: Array, phi: Array, noise: Array) -> tuple[Array, Array]:
    r"""Return :math:`\Phi x` and :math:`\Phi P \Phi^T + Q`, for Phi and Q (n, n) or (trials, n, n).

    Without a mean (trials, n) only the covariances are predicted.
    """
    spread = plain(covariance)
    n = spread.shape[-1]
    states = np.empty((0, n)) if mean is None else plain(mean)
    moved, out = np.empty(states.shape), np.empty(spread.shape)
    phis, noises = plain(phi.reshape(-1, n, n)), plain(noise.reshape(-1, n, n))
    arguments = states, spread, phis, noises, np.empty((n, n)), moved, out
    call(ready("predicting:by_matrix"), arguments, spread.shape[0], _BY_MATRIX)
    return moved, out


def by_kernel(mean: Array, covariance: Array, step: Step, held: Array | None) -> tuple[Array, Array]:
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
    arguments = states, spread, inputs, step.parts, step.parameters, step.noise, np.empty((3, n, n)), moved, out
    code = call(ready("predicting:by_kernel"), arguments, states.shape[0], _BY_KERNEL)
    if code >= 0:
        raise ValueError(f"motion: its kernel raised for a state {states[code >> 8].tolist()}")
    return moved, out
