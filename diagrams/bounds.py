"""The posterior Cramer-Rao bound along each trial's own truth.

The recursion is that of a Kalman filter linearised at the truth; what a study shows is the square root of the mean
over the trials of the trace. (The mean of the *information* would turn the one weak direction of a passive geometry
away and give a bound several times too small.)
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from diagrams.metrics import QUANTITIES
from diagrams.system import Wired
from systems.estimators.base import Estimator
from systems.filters.linear_algebra import cholesky, symmetric
from systems.filters.square_root import Gains
from systems.filters.whitening import Whitener, whitened_jacobian
from systems.frames import up
from systems.measurement.base import MeasurementModel
from systems.motion.base import MotionModel

__all__ = [
    "BoundSums",
    "StudyBounds",
    "add_bounds",
    "alike",
    "bound_curves",
    "bound_squares",
    "bound_steps",
    "posterior_bound",
    "rows_present",
]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


def posterior_bound(
    truth: Array,
    platforms: Array,
    times: ArrayLike,
    model: MeasurementModel,
    motion: MotionModel,
    start_covariance: Array,
    first_epoch_used: bool,
    present: Mask | None = None,
) -> Array:
    r"""Return the posterior Cramer-Rao bound of every trial at every epoch.

    .. math:: J_{k+1} = (\Phi_k J_k^{-1} \Phi_k^T + Q_k)^{-1} + H_{k+1}^T R^{-1} H_{k+1}, \qquad P_k = J_k^{-1}

    Tichavsky, Muravchik and Nehorai, *Posterior Cramer-Rao bounds for discrete-time nonlinear filtering*, IEEE Trans.
    Signal Processing 46 (1998) 1386-1396, eq. (34), with the expectations replaced by their value along the trial's own
    truth.

    Parameters
    ----------
    truth : ndarray, shape (trials or 1, time, n)
        States; the Jacobians are taken here. Where a number is NaN no measurement counts.
    platforms : ndarray, shape (trials or 1, time, p, 6)
        Known carriers.
    times : array_like, shape (time,)
        Every epoch, not only those that are stored [s].
    model : MeasurementModel
        Measurement of every epoch.
    motion : MotionModel
        Motion between the epochs; its process noise may be zero.
    start_covariance : ndarray, shape (trials or 1, n, n) or (n, n)
        At the first epoch.
    first_epoch_used : bool
        True: the first epoch's measurement is already in the start.
    present : ndarray of bool, shape (trials or 1, time, m), optional
        Which rows were measured; by default all.

    Returns
    -------
    ndarray, shape (trials, time, n, n)
        Covariances: the bound after the measurement of the epoch; NaN in a trial that cannot be computed.
    """
    steps = bound_steps(truth, platforms, times, model, motion, start_covariance, first_epoch_used, present)
    return np.stack(list(steps), axis=1)


def bound_steps(
    truth: Array,
    platforms: Array,
    times: ArrayLike,
    model: MeasurementModel,
    motion: MotionModel,
    start_covariance: Array,
    first_epoch_used: bool,
    present: Mask | None = None,
) -> Iterator[Array]:
    """Yield the bound (trials, n, n) of one epoch after the other; see `posterior_bound`."""
    t = np.asarray(times, dtype=float)
    start = np.asarray(start_covariance, dtype=float)
    start = start if start.ndim == 3 else start[None]
    leading = [truth.shape[0], platforms.shape[0], start.shape[0], 1 if present is None else present.shape[0]]
    trials = max(leading)
    if any(count not in (1, trials) for count in leading):
        raise ValueError(f"trials of truth, platforms, start and present are {leading}; each must be 1 or {trials}")
    if not truth.shape[1] == platforms.shape[1] == t.size:
        raise ValueError(f"epochs of truth, platforms and times are {truth.shape[1]}, {platforms.shape[1]}, {t.size}")
    if start.shape[-1] != motion.size:
        raise ValueError(f"the start has {start.shape[-1]} states, the motion model {motion.size}")

    varies = type(model).noise_covariance_at is not MeasurementModel.noise_covariance_at
    whitener = Whitener(model.noise_covariance())
    covariance, lost = _without_lost(np.broadcast_to(start, (trials, *start.shape[1:])), np.zeros(trials, dtype=bool))
    # A square root is carried from epoch to epoch: a prior of nearly rank one then loses no digits, and stays
    # definite where there is no process noise.
    root = cholesky(covariance)
    for k in range(t.size):
        if k > 0:
            state, dt = truth[:, k - 1], float(t[k] - t[k - 1])
            noise = motion.process_noise(state, dt)
            root, lost = _without_lost(motion.transition(state, dt) @ root, lost)
            if np.any(noise):
                covariance, lost = _without_lost(symmetric(root @ np.swapaxes(root, -1, -2)) + noise, lost)
                root = cholesky(covariance)
        if k > 0 or not first_epoch_used:
            seen = None if present is None else present[:, k]
            if varies:
                whitener = Whitener(model.noise_covariance_at(truth[:, k], platforms[:, k]))
            rows = whitened_jacobian(model.jacobian(truth[:, k], platforms[:, k]), whitener, seen) @ root
            root = Gains(root, rows).root()
        yield np.where(lost[:, None, None], np.nan, root @ np.swapaxes(root, -1, -2))


def _without_lost(matrices: Array, lost: Mask) -> tuple[Array, Mask]:
    """Return matrices (trials, n, n) with a stand-in where one is not finite, and which trials are lost by now."""
    broken = ~np.all(np.isfinite(matrices), axis=(-1, -2), keepdims=True)[:, 0, 0]
    if not broken.any():
        return matrices, lost
    return np.where(broken[:, None, None], np.eye(matrices.shape[-1]), matrices), lost | broken


# --------------------------------------------------------------------------------------------- over trials


def bound_squares(
    covariance: Array, truth: Array, axes: int = 3, frame: str = "earth_fixed", bias: int | None = None
) -> Array:
    """Return the squared bounds of every trial.

    Parameters
    ----------
    covariance : ndarray, shape (..., n, n)
        Of states that begin with position [m] and velocity [m/s].
    truth : ndarray, shape (..., n)
        Broadcasts with it.
    axes : int
        Number of space dimensions.
    frame : {'earth_fixed', 'local'}
        Axes of the states; see `Wired`.
    bias : int, optional
        Which component of the state is a bias.

    Returns
    -------
    ndarray, shape (6, ...)
        In the order of `diagrams.metrics.QUANTITIES`: trace of the position part [m^2], variance along the
        ellipsoid's normal [m^2], trace of the velocity part [m^2/s^2], variance of the velocity along the horizontal
        course [m^2/s^2] and, across it, of the course [deg^2], variance of the bias. NaN for what is not in the
        state, and for the course of a target at rest. (That the local axes turn with the place, 1e-7 rad/m, is left
        out of speed and course.)
    """
    place, state = covariance[..., :axes, :axes], truth[..., :axes]
    position = _trace(place)
    undefined = np.full(position.shape, np.nan)
    if frame == "local":
        normal = np.broadcast_to([0.0, 0.0, 1.0], (*state.shape[:-1], 3))
        height = undefined if axes < 3 else place[..., 2, 2]
    else:
        normal = up(state)
        height = _variance(place, normal)
    biased = undefined if bias is None else covariance[..., bias, bias]
    if covariance.shape[-1] < 2 * axes:
        return np.stack(np.broadcast_arrays(position, height, undefined, undefined, undefined, biased))
    moving, velocity = covariance[..., axes : 2 * axes, axes : 2 * axes], truth[..., axes : 2 * axes]
    if axes < 3:  # level motion
        moving = np.pad(moving, [(0, 0)] * (moving.ndim - 2) + [(0, 3 - axes)] * 2)
        velocity = np.pad(velocity, [(0, 0)] * (velocity.ndim - 1) + [(0, 3 - axes)])
    level = velocity - normal * np.sum(normal * velocity, axis=-1, keepdims=True)
    speed = np.linalg.norm(level, axis=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        ahead = level / np.where(speed > 0, speed, np.nan)[..., None]
        turn = np.degrees(np.cross(ahead, normal)) / speed[..., None]
    parts = position, height, _trace(moving), _variance(moving, ahead), _variance(moving, turn), biased
    return np.stack(np.broadcast_arrays(*parts))


def _trace(matrix: Array) -> Array:
    return np.trace(matrix, axis1=-2, axis2=-1)


def _variance(covariance: Array, direction: Array) -> Array:
    # not einsum: with three factors its rounding depends on the number of trials
    return (direction[..., None, :] @ covariance @ direction[..., None])[..., 0, 0]


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
        each = np.broadcast_to(squares, (*squares.shape[:-1], trials))
        known = np.isfinite(each)
        parts = np.concatenate([self._sums[..., None], np.where(known, each, 0.0)], axis=-1)
        self._sums = np.cumsum(parts, axis=-1)[..., -1]
        self._counts += np.count_nonzero(known, axis=-1)

    def curves(self) -> dict[str, Array]:
        """Return the bounds by quantity, each (time,): square root of the mean over the trials."""
        mean = self._sums / np.where(self._counts > 0, self._counts, np.nan)
        return dict(zip(QUANTITIES, np.sqrt(mean), strict=True))


def bound_curves(covariance: Array, truth: Array) -> dict[str, Array]:
    """Return the bounds against time: square root of the mean over the trials.

    Parameters
    ----------
    covariance : ndarray, shape (trials, time, n, n)
        From `posterior_bound`.
    truth : ndarray, shape (trials or 1, time, n)

    Returns
    -------
    dict of str to ndarray, shape (time,)
        ``position`` [m], ``height`` [m], ``velocity`` [m/s], ``speed`` [m/s], ``course`` [deg].
    """
    sums = BoundSums(covariance.shape[1])
    sums.add(np.moveaxis(bound_squares(covariance, truth), 1, -1), covariance.shape[0])
    return {name: curve for name, curve in sums.curves().items() if name != "bias"}


# ------------------------------------------------------------------------------------------------ of a study


@dataclass
class StudyBounds:
    """Both bounds of every estimator of a diagram, summed chunk by chunk.

    ``bound``: what the estimator's motion model allows (its process noise). ``bound_truth``: the same measurements and
    start, with the process noise of the motion that was simulated. Estimators whose sensor, motion and start are alike
    share the work. Estimators whose state is not the truth's have no bound (NaN);
    neither has ``bound_truth`` where the truth moves as none of the motion models.

    Parameters
    ----------
    wired : Wired
        The diagram.
    times : ndarray, shape (time,)
        Every epoch of the clock [s].
    """

    wired: Wired
    times: Array
    _sums: dict[tuple[str, str], BoundSums] = field(default_factory=dict)

    def add(self, truth: Array, platforms: Array, trials: int | None = None, present: Mask | None = None) -> None:
        """Add a chunk of trials.

        Parameters
        ----------
        truth : ndarray, shape (trials or 1, time, n)
            1 where all trials share it.
        platforms : ndarray, shape (trials or 1, time, p, 6)
            Known carriers.
        trials : int, optional
            Trials of the chunk; by default those of truth, platforms and `present`.
        present : ndarray of bool, shape (trials or 1, time, rows of the measurement stream), optional
            Which rows were measured; by default all.
        """
        if present is not None and (present == present[:1]).all():
            present = present[:1]
        arrays = [truth, platforms] if present is None else [truth, platforms, present]
        count = trials or max(array.shape[0] for array in arrays)
        done: list[tuple[tuple[Any, ...], Array]] = []
        for name, estimator in self.wired.estimators.items():
            for kind, motion in (("bound", estimator.motion), ("bound_truth", self.wired.truth_motion)):
                squares = self._squares(name, estimator, motion, truth, platforms, present, done)
                sums = self._sums.setdefault((name, kind), BoundSums(self.times.size))
                sums.add(squares, count)

    def _squares(
        self,
        name: str,
        estimator: Estimator,
        motion: MotionModel | None,
        truth: Array,
        platforms: Array,
        present: Mask | None,
        done: list[tuple[tuple[Any, ...], Array]],
    ) -> Array:
        n = truth.shape[-1]
        if motion is None or not estimator.motion.size == motion.size == n:
            return np.full((len(QUANTITIES), self.times.size, 1), np.nan)
        start = self.wired.start_covariance(name, truth[:, 0], platforms[:, 0])
        model = estimator.bound_model
        key = (model, motion, start)
        for known, squares in done:
            if alike(key, known):
                return squares
        seen = None
        if present is not None:
            seen = rows_present(self.wired, estimator, present)
        steps = bound_steps(truth, platforms, self.times, model, motion, start, self.wired.start_uses_measurement, seen)
        axes, frame = self.wired.axes, self.wired.frame
        bias = estimator.motion.names.index("bias") if "bias" in estimator.motion.names else None
        squares = np.stack([bound_squares(p, truth[:, k], axes, frame, bias) for k, p in enumerate(steps)], axis=1)
        done.append((key, squares))
        return squares

    def variables(self) -> dict[str, tuple[tuple[str, str], Array]]:
        """Return the variables (estimator, time) of a study's result, ``bound_position`` ... ``bound_truth_course``.

        The estimators are in the diagram's order, the epochs are all of the clock.
        """
        # heights and courses refer to the ellipsoid
        shown = {*QUANTITIES} if self.wired.frame in ("earth_fixed", "local") else {"position", "velocity", "bias"}
        if not any("bias" in estimator.motion.names for estimator in self.wired.estimators.values()):
            shown.discard("bias")
        found = {}
        names = list(self.wired.estimators)
        for kind in ("bound", "bound_truth"):
            curves = [self._sums[name, kind].curves() for name in names]
            for what in (quantity for quantity in QUANTITIES if quantity in shown):
                found[f"{kind}_{what}"] = (("estimator", "time"), np.stack([curve[what] for curve in curves]))
        return found


def rows_present(wired: Wired, estimator: Estimator, present: Mask) -> Mask:
    """Return which rows of an estimator's `bound_model` were measured, shape (..., m).

    Parameters
    ----------
    wired : Wired
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


def add_bounds(
    dataset: xr.Dataset, wired: Wired, truth: Array, platforms: Array, present: Mask | None = None
) -> xr.Dataset:
    """Return a study's result with the bounds of its estimators.

    Parameters
    ----------
    dataset : xarray.Dataset
        Result that holds *every* epoch of the clock; where epochs are left out, use `StudyBounds`.
    wired : Wired
        The diagram.
    truth : ndarray, shape (trials or 1, time, n)
    platforms : ndarray, shape (trials or 1, time, p, 6)
    present : ndarray of bool, shape (trials or 1, time, rows of the measurement stream), optional
        Which rows were measured.

    Returns
    -------
    xarray.Dataset
        With ``bound_position`` ... and ``bound_truth_position`` ... (estimator, time), for all quantities.
    """
    bounds = StudyBounds(wired, np.asarray(dataset["time"].values, dtype=float))
    bounds.add(truth, platforms, dataset.sizes["trial"], present)
    names = [str(name) for name in dataset["estimator"].values]
    made = xr.Dataset(bounds.variables(), coords={"estimator": list(wired.estimators), "time": dataset["time"]})
    return dataset.merge(made.sel(estimator=names))
