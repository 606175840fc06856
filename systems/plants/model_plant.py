"""Truth from a motion model: random start and process noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import Context, DiscreteValues

from quietfix.systems.clocks import Clock
from quietfix.systems.linear_algebra import semidefinite_root
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.noise import normal
from quietfix.systems.signals import EnsembleBlock, check_trials

__all__ = ["ModelPlant"]

Array = NDArray[np.float64]

_KEPT_ROOTS = 64


class ModelPlant(EnsembleBlock):
    r"""Truth that moves exactly as a motion model says: what a consistency test needs, and every random walk.

    The start is N(mean, covariance) per trial; at tick k the state is ``propagate(state at tick k - 1)``
    plus a draw of the model's process noise; between ticks it is the propagated state. Port: ``state``
    (trials, n).

    .. math:: x_0 \sim N(\bar x, P), \qquad x_k = f(x_{k-1}) + w_k, \qquad w_k \sim N(0, Q(t_k - t_{k-1}))

    Parameters
    ----------
    motion : MotionModel
        How the state moves.
    clock : Clock
        When process noise is added; a tick at time 0 adds none.
    mean : array_like, shape (n,) or (trials, n)
        Mean of the start, at the time when the simulation begins.
    covariance : array_like, shape (n, n) or (trials, n, n)
        Covariance of the start; may be singular or zero.
    trials : int
        Number of trials, >= 1.
    name : str
        Name of the block; part of the key of its random numbers.

    Raises
    ------
    ValueError
        For wrong shapes, numbers that are not finite, a covariance that is none.

    Notes
    -----
    Draws depend on (seed, name, trial, tick) alone. The port carries the drawn start even before
    `Simulator.Initialize` stores it: all blocks are initialised at once, and an estimator that starts from a
    measurement reads this port then. Seed and first trial are to be set before that.
    """

    def __init__(
        self,
        motion: MotionModel,
        clock: Clock,
        mean: ArrayLike,
        covariance: ArrayLike,
        trials: int,
        name: str = "emitter",
    ) -> None:
        super().__init__(name)
        self.motion = motion
        self.clock = clock
        self.trials = check_trials(trials)
        n = motion.size
        self.mean = _shaped(f"{name} mean", mean, (n,), self.trials)
        _shaped(f"{name} covariance", covariance, (n, n), self.trials)
        self._start_root = semidefinite_root(covariance)
        self._noise_roots: dict[float, Array] = {}
        default = np.broadcast_to(self.mean, (self.trials, n))
        self._x = self.DeclareDiscreteState(default.ravel())
        self._stamp = self.DeclareDiscreteState([0.0, 0.0, np.nan])  # holds for this time; is stored; begun then
        draw = self.declare_draw()
        now = self.declare_cached("now", ModelPlant._now, {self.xd_ticket(), self.time_ticket(), draw})
        self._state = now
        self.declare_output("state", self.trials, n, self._read_state, {self.cached_ticket(now)})
        self.DeclareInitializationDiscreteUpdateEvent(self._start)
        clock.declare(lambda period, offset: self.DeclarePeriodicDiscreteUpdateEvent(period, offset, self._advance))

    def _read_state(self, context: Context) -> Array:
        return self.cached(context, self._state)

    def _first(self, context: Context) -> Array:
        draw, n = self.draw(context), self.motion.size
        # a key of its own: sample 0 of the block's name belongs to tick 0
        z = normal(draw.seed, f"{self.noise_name()}:start", draw.first_trial, self.trials, 0, n)
        return self.mean + _times(self._start_root, z)

    def _start(self, context: Context, discrete: DiscreteValues) -> None:
        time = context.get_time()
        if discrete.get_value(self._stamp)[2] < time:  # a context that was continued in another Simulator
            return
        discrete.set_value(self._x, np.ravel(self._first(context)))
        discrete.set_value(self._stamp, [time, 1.0, time])

    def _now(self, context: Context) -> Array:
        valid_at, started, begun = context.get_discrete_state(self._stamp).get_value()
        if not started or context.get_time() <= begun:  # <: a context that was set back
            return self._first(context)
        x = context.get_discrete_state(self._x).get_value().reshape(self.trials, -1).copy()
        time = context.get_time()
        dt = time - valid_at
        if dt <= 0:
            return x
        moved = self.motion.propagate(x, dt)
        tick = self.clock.index(time)
        if tick is None:
            return moved
        draw = self.draw(context)
        z = normal(draw.seed, self.noise_name(), draw.first_trial, self.trials, tick, self.motion.size)
        return moved + _times(self._noise_root(x, dt), z)

    def _noise_root(self, x: Array, dt: float) -> Array:
        if dt in self._noise_roots:
            return self._noise_roots[dt]
        q = np.asarray(self.motion.process_noise(x, dt), dtype=float)
        root = semidefinite_root(q)
        if q.ndim == 2:  # a motion model answers (n, n) where the noise does not depend on the state
            if len(self._noise_roots) >= _KEPT_ROOTS:
                self._noise_roots.clear()
            self._noise_roots[dt] = root
        return root

    def _advance(self, context: Context, discrete: DiscreteValues) -> None:
        # logs at this tick have already shown this value: it must be stored, not computed again one step on
        discrete.set_value(self._x, np.ravel(self.cached(context, self._state)))
        begun = discrete.get_value(self._stamp)[2]
        discrete.set_value(self._stamp, [context.get_time(), 1.0, begun])


def _times(matrix: Array, vector: Array) -> Array:
    """Return ``matrix @ vector`` per trial, bit-equal whether a trial is alone or in a batch."""
    return (matrix @ vector[..., None])[..., 0]


def _shaped(what: str, value: ArrayLike, shape: tuple[int, ...], trials: int) -> Array:
    array = np.array(value, dtype=float)
    if array.shape not in (shape, (trials, *shape)):
        raise ValueError(f"{what}: shape {array.shape} is not allowed; {shape} or {(trials, *shape)}")
    if not np.all(np.isfinite(array)):
        raise ValueError(f"{what}: all numbers must be finite")
    return array
