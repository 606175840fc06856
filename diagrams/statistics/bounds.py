"""The posterior Cramer-Rao bound along each trial's own truth.

The recursion is that of a Kalman filter linearised at the truth; what a study shows is the square root of the mean
over the trials of the trace. (The mean of the *information* would turn the one weak direction of a passive geometry
away and give a bound several times too small.)
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.build import Assembly
from quietfix.diagrams.quantities.frame import EARTH_FIXED, Frame, as_frame
from quietfix.diagrams.quantities.states import (
    POSITION,
    VELOCITY,
    CarriedMotion,
    Moves,
    block,
    columns,
    shared,
    translated,
)
from quietfix.diagrams.statistics.paths.smoothing_bound import smoothing_bound
from quietfix.diagrams.statistics.posterior_bound import bound_steps
from quietfix.diagrams.statistics.state_errors import NEEDED, QUANTITIES
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.kernels.scoring.calls import add_finite
from quietfix.systems.motion.base import MotionModel

__all__ = [
    "BoundSums",
    "StudyBounds",
    "alike",
    "bound_squares",
    "rows_arriving",
    "rows_present",
]

_KINDS = ("bound", "bound_truth")
_AT_ONCE = 1000  # covariances judged in one go: a few hundred kilobytes

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


# --------------------------------------------------------------------------------------------- over trials


def bound_squares(
    covariance: Array,
    truth: Array,
    names: Sequence[str] = (*POSITION, *VELOCITY),
    frame: Frame | str = EARTH_FIXED,
) -> Array:
    """Return the squared bounds of every trial.

    Parameters
    ----------
    covariance : ndarray, shape (..., n, n)
        Of states of the components `names`, in any order.
    truth : ndarray, shape (..., n)
        Broadcasts with it.
    names : sequence of str
        Position is what of x, y, z [m] is there, velocity what of vx, vy, vz [m/s]; ``bias`` [m/s].
    frame : Frame, or its name
        Axes of the states.

    Returns
    -------
    ndarray, shape (6, ...)
        In the order of `quietfix.diagrams.statistics.state_errors.QUANTITIES`: trace of the position part [m^2],
        variance along the frame's upward direction [m^2], trace of the velocity part [m^2/s^2], variance of the
        velocity along the horizontal course [m^2/s^2] and, across it, of the course [deg^2], variance of the bias. NaN
        for what is not in the state, and for the course of a target at rest. (That the local axes turn with the place,
        1e-7 rad/m, is left out of speed and course.)
    """
    axes = as_frame(frame)
    has = axes.quantities(names)
    placed, moving = shared(POSITION, names), shared(VELOCITY, names)
    undefined = np.full(np.broadcast_shapes(covariance.shape[:-2], truth.shape[:-1]), np.nan)
    position = height = total = ahead = across = biased = undefined
    if placed:
        place, state = block(covariance, columns(names, placed)), truth[..., columns(names, placed)]
        position = _trace(place)
        if axes.up is not None and "height" in has:
            height = _variance(place, axes.up(state))
    if moving:
        own, velocity = block(covariance, columns(names, moving)), truth[..., columns(names, moving)]
        total = _trace(own)
        if axes.up is not None and "speed" in has:
            normal = axes.up(truth[..., columns(names, placed)])
            ahead, across = _level_variances(own, velocity, normal)
    if "bias" in has:
        biased = block(covariance, columns(names, ["bias"]))[..., 0, 0]
    return np.stack(np.broadcast_arrays(position, height, total, ahead, across, biased))


def _level_variances(covariance: Array, velocity: Array, normal: Array) -> tuple[Array, Array]:
    """Return the variances of the velocity along the horizontal course [m^2/s^2] and of the course [deg^2]."""
    missing = 3 - velocity.shape[-1]  # level motion in the plane
    if missing:
        covariance = np.pad(covariance, [(0, 0)] * (covariance.ndim - 2) + [(0, missing)] * 2)
        velocity = np.pad(velocity, [(0, 0)] * (velocity.ndim - 1) + [(0, missing)])
    level = velocity - normal * np.sum(normal * velocity, axis=-1, keepdims=True)
    speed = np.linalg.norm(level, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        ahead = level / np.where(speed > 0, speed, np.nan)[..., None]
        turn = np.degrees(np.cross(ahead, normal)) / speed[..., None]
    return _variance(covariance, ahead), _variance(covariance, turn)


def _trace(matrix: Array) -> Array:
    return np.trace(matrix, axis1=-2, axis2=-1)


def _variance(covariance: Array, direction: Array) -> Array:
    # not einsum: with three factors its rounding depends on the number of trials
    return (direction[..., None, :] @ covariance @ direction[..., None])[..., 0, 0]


def _squares_of(
    steps: Iterator[Array], places: slice | list[int], state: Array, names: Sequence[str], axes: Frame
) -> Array:
    """Return the squares (6, time, trials) of one epoch after the other, at states (trials or 1, time, n)."""
    parts: list[Array] = []
    waiting: list[Array] = []
    first = 0
    for k in range(state.shape[1]):
        waiting.append(block(next(steps), places))
        if k + 1 == state.shape[1] or len(waiting) * len(waiting[0]) >= _AT_ONCE:
            here = np.swapaxes(state[:, first : k + 1], 0, 1)
            parts.append(bound_squares(np.stack(waiting), here, names, axes))
            waiting, first = [], k + 1
    return np.concatenate(parts, axis=1)


class BoundSums:
    """Sums over trials of the squared bounds, so that the chunks of a study can be added up.

    Parameters
    ----------
    epochs : int
        How many epochs there are.
    """

    def __init__(self, epochs: int) -> None:
        self._sums = np.zeros((len(QUANTITIES), epochs))
        self._counts = np.zeros((len(QUANTITIES), epochs))

    def add(self, squares: Array, trials: int) -> None:
        """Add squares (6, time, trials or 1) of a chunk of `trials`; those that are NaN are not counted.

        One trial after the other, so that the sum does not depend, to the last bit, on how a study is cut.
        """
        self._sums, self._counts = self._sums.copy(), self._counts.copy()  # `parts` may have given them away
        add_finite(squares.reshape(-1, squares.shape[-1]), trials, self._sums.reshape(-1), self._counts.reshape(-1))

    @property
    def parts(self) -> Array:
        """Sums and counts, (2, 6, time); those of several can be added."""
        return np.stack([self._sums, self._counts])

    @parts.setter
    def parts(self, parts: Array) -> None:
        self._sums, self._counts = parts

    def curves(self) -> dict[str, Array]:
        """Return the bounds by quantity, each (time,): square root of the mean over the trials."""
        mean = self._sums / np.where(self._counts > 0, self._counts, np.nan)
        return dict(zip(QUANTITIES, np.sqrt(mean), strict=True))


# ------------------------------------------------------------------------------------------------ of a study


@dataclass
class StudyBounds:
    """Both bounds of every estimator of a diagram, summed chunk by chunk.

    ``bound``: what the estimator's motion model allows (its process noise). ``bound_truth``: the same measurements and
    start, with the process noise of the motion that was simulated; NaN where the truth moves as none of the motion
    models. Estimators whose sensor, motion and start are alike share the work.

    The recursion is that of the estimator's own state, whatever the truth's: the Jacobians are taken at each trial's
    truth, written as the estimator's state by the names of the components. What the truth lacks is there at its
    `MotionModel.nominal` value, 0 unless the model says otherwise: a truth without a bias has the bias zero. Such a
    component makes the others harder to know, and has no bound itself, for it has no error. What the estimator lacks it
    takes as known; where the truth of it is not what the estimator's model makes of it, the estimator is biased, and no
    bound on its variance bounds its error. The true motion is carried into another state by `CarriedMotion`.

    Parameters
    ----------
    wired : Assembly
        The diagram.
    times : ndarray, shape (time,)
        Every epoch of the clock [s].
    """

    wired: Assembly
    times: Array
    _sums: dict[tuple[str, str], BoundSums] = field(default_factory=dict)
    _warned: set[str] = field(default_factory=set)
    _shared: tuple[Any, list[tuple[tuple[Any, ...], Array]]] = field(default_factory=lambda: (None, []))

    def __post_init__(self) -> None:
        """Note what the states are called."""
        self.truth_names = self.wired.truth_names
        self._judged = shared(self.wired.estimated_names, self.truth_names)

    def add(
        self,
        truth: Array,
        platforms: Array,
        trials: int | None = None,
        present: Mask | None = None,
        arrival: Array | None = None,
    ) -> None:
        """Add a chunk of trials.

        Parameters
        ----------
        truth : ndarray, shape (trials or 1, time, n)
            1 where all trials share it.
        platforms : ndarray, shape (trials or 1, time, p, 6)
            Known platforms.
        trials : int, optional
            Trials of the chunk; by default those of truth, platforms and `present`.
        present : ndarray of bool, shape (trials or 1, time, rows of the measurement stream), optional
            Which rows were measured; by default all.
        arrival : ndarray, shape (trials, time, rows of the measurement stream), optional
            When each of them comes, where some are late [s].
        """
        if present is not None and (present == present[:1]).all():
            present = present[:1]
        if arrival is not None and (arrival == arrival[:1]).all():
            arrival = arrival[:1]
        arrays = [truth, platforms] if present is None else [truth, platforms, present]
        count = trials or max(array.shape[0] for array in arrays)
        done = self._known(truth, platforms, present, arrival)
        for name, estimator in self.wired.estimators.items():
            for kind, motion in zip(_KINDS, (estimator.motion, self.wired.model.truth_motion), strict=True):
                squares = self._squares(name, estimator, motion, truth, platforms, present, arrival, done)
                sums = self._sums.setdefault((name, kind), BoundSums(self.times.size))
                sums.add(squares, count)

    def _known(self, *given: NDArray[Any] | None) -> list[tuple[tuple[Any, ...], Array]]:
        """Return what is known of such a chunk: where its trials share all that a bound is made of, it comes again."""
        if any(array is not None and array.shape[0] != 1 for array in given):
            return []
        if not alike(given, self._shared[0]):
            self._shared = tuple(None if array is None else array.copy() for array in given), []
        return self._shared[1]

    def take(self) -> Array:
        """Return the sums of what was added, (estimators, 2, 2, 6, time), and begin anew; sums can be added."""
        taken = np.stack([[self._sums[name, kind].parts for kind in _KINDS] for name in self.wired.estimators])
        self._sums = {}
        return taken

    def put(self, taken: Array) -> None:
        """Go on from sums that `take` gave."""
        for name, kinds in zip(self.wired.estimators, taken, strict=True):
            for kind, parts in zip(_KINDS, kinds, strict=True):
                self._sums[name, kind] = BoundSums(self.times.size)
                self._sums[name, kind].parts = parts

    def _squares(
        self,
        name: str,
        estimator: Estimator,
        motion: MotionModel | None,
        truth: Array,
        platforms: Array,
        present: Mask | None,
        arrival: Array | None,
        done: list[tuple[tuple[Any, ...], Array]],
    ) -> Array:
        own, names = estimator.motion, self.truth_names
        undefined = np.full((len(QUANTITIES), self.times.size, 1), np.nan)
        if motion is None:
            return undefined
        moves: Moves = motion
        if motion is not own and tuple(motion.names) != tuple(own.names):
            if not set(shared(own.names, names)) <= set(motion.names):
                return undefined  # of some of it nobody says how it moves
            moves = CarriedMotion(motion, own, names)
        state = translated(truth, names, own)
        start, spent = estimator.bound_prior(state[:, 0], platforms[:, 0])
        if start is None or start.shape[-1] != own.size:
            self._warn_without_prior(name, estimator, start)
            return undefined
        model = estimator.bound_model
        looks = estimator.smoother
        key = (model, moves, own.names, start, spent, looks and (looks.lag,))
        for known, squares in done:
            if alike(key, known):
                return squares
        seen = None if present is None else rows_present(self.wired, estimator, present)
        flown = truth if isinstance(moves, CarriedMotion) else None
        comes = None if arrival is None else rows_arriving(self.wired, estimator, arrival)
        if comes is not None and looks is not None:  # it looks back when all has come
            seen = np.isfinite(comes) if seen is None else seen & np.isfinite(comes)
            comes = None
        steps = bound_steps(state, platforms, self.times, model, moves, start, spent, seen, flown, comes)
        if looks is not None:
            steps = iter(smoothing_bound(steps, state if flown is None else flown, self.times, moves, looks.lag))
        both = shared(own.names, names)
        places = columns(own.names, both)
        squares = _squares_of(steps, places, state[..., places], both, self.wired.model.axes)
        squares[[not self._complete(what, both) for what in QUANTITIES]] = np.nan
        done.append((key, squares))
        return squares

    def _complete(self, quantity: str, names: Sequence[str]) -> bool:
        """Return whether a state has all that the quantity is made of, as far as the study has it at all."""
        return set(shared(NEEDED[quantity], self._judged)) <= set(names)

    def _warn_without_prior(self, name: str, estimator: Estimator, start: Array | None) -> None:
        size = estimator.motion.size
        if name not in self._warned:
            said = "does not say its covariance" if start is None else f"has {start.shape[-1]} states"
            warnings.warn(
                f"estimators.{name}: no bound, its start {said}; covariance_at must return {size} x {size}",
                stacklevel=2,
            )
        self._warned.add(name)

    def variables(self) -> dict[str, tuple[tuple[str, str], Array]]:
        """Return the variables (estimator, time) of a study's result, ``bound_position`` ... ``bound_truth_course``.

        The estimators are in the diagram's order, the epochs are all of the clock.
        """
        # all that the frame knows, also where this target is in a plane, or at rest
        shown = {*self.wired.model.axes.quantities((*POSITION, *VELOCITY, *shared(("bias",), self._judged)))}
        found = {}
        names = list(self.wired.estimators)
        for kind in _KINDS:
            curves = [self._sums[name, kind].curves() for name in names]
            for what in (quantity for quantity in QUANTITIES if quantity in shown):
                found[f"{kind}_{what}"] = (("estimator", "time"), np.stack([curve[what] for curve in curves]))
        return found


def rows_present(wired: Assembly, estimator: Estimator, present: Mask) -> Mask:
    """Return which rows of an estimator's `bound_model` were measured, shape (..., m).

    Parameters
    ----------
    wired : Assembly
    estimator : Estimator
        One of its estimators.
    present : ndarray of bool, shape (..., rows of the measurement stream)
        Which rows of the stream were measured.
    """
    model = estimator.bound_model
    stream = list(wired.stream or estimator.wiring.stream)
    if set(model.names) <= set(stream) and present.shape[-1] == len(stream):
        return present[..., [stream.index(row) for row in model.names]]
    # rows that are made of all that is measured
    return np.repeat(present.all(axis=-1, keepdims=True), model.size, axis=-1)


def rows_arriving(wired: Assembly, estimator: Estimator, arrival: Array) -> Array:
    """Return when the rows of an estimator's `bound_model` come [s], shape (..., m); arguments as of `rows_present`."""
    model = estimator.bound_model
    stream = list(wired.stream or estimator.wiring.stream)
    if set(model.names) <= set(stream) and arrival.shape[-1] == len(stream):
        return arrival[..., [stream.index(row) for row in model.names]]
    return np.repeat(arrival.max(axis=-1, keepdims=True), model.size, axis=-1)


def alike(a: Any, b: Any) -> bool:
    """Return whether two things are the same in all that they consist of."""
    if a is b:
        return True
    if type(a) is not type(b):
        return False
    if isinstance(a, np.ndarray):
        return bool(np.array_equal(a, b, equal_nan=a.dtype.kind == "f"))
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(alike(p, q) for p, q in zip(a, b, strict=True))
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(alike(a[key], b[key]) for key in a)
    if hasattr(a, "__dict__") and not callable(a):
        return alike(vars(a), vars(b))
    return bool(a == b)
