"""Truth from a record: interpolated samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import Context

from quietfix.systems.signals import EnsembleBlock
from quietfix.systems.trajectories.polynomial import polynomial_states

__all__ = ["RecordedTruth", "hermite"]

Array = NDArray[np.float64]

_ORDER = 4  # of the polynomials that give velocities: a log has noise, which higher orders amplify


def hermite(times: Array, states: Array, time: float) -> tuple[Array, Array]:
    """Interpolate position and velocity samples by a cubic Hermite spline.

    Parameters
    ----------
    times : ndarray, shape (samples,)
        Strictly increasing [s].
    states : ndarray, shape (samples, ..., 6)
        Position [m] and velocity [m/s].
    time : float
        Where to interpolate [s].

    Returns
    -------
    state : ndarray, shape (..., 6)
        Position and its derivative; NaN outside the record and where a neighbouring sample is NaN.
    acceleration : ndarray, shape (..., 3)
        Second derivative of the position [m/s^2]; at a sample that of the interval after it.

    Notes
    -----
    Between two samples the error of the position is at most h^4/384 times the fourth derivative of the
    motion.
    """
    if not times[0] <= time <= times[-1]:
        return np.full(states.shape[1:], np.nan), np.full((*states.shape[1:-1], 3), np.nan)
    i = min(int(np.searchsorted(times, time, side="right")) - 1, len(times) - 2)
    h = times[i + 1] - times[i]
    s = (time - times[i]) / h
    p0, v0 = states[i, ..., :3], states[i, ..., 3:6]
    p1, v1 = states[i + 1, ..., :3], states[i + 1, ..., 3:6]
    # about p0 and not in Hermite's basis: large coordinates do not cancel, and samples are met exactly
    chord = (p1 - p0) / h
    a2, a3 = 3 * chord - 2 * v0 - v1, v0 + v1 - 2 * chord
    position = p0 + h * s * (v0 + s * (a2 + s * a3)) if s < 1 else p1
    velocity = v0 + s * (2 * a2 + 3 * s * a3) if s < 1 else v1
    return np.concatenate([position, velocity], axis=-1), (2 * a2 + 6 * s * a3) / h


def _with_velocities(times: Array, positions: Array) -> Array:
    """Return states (samples, trials, 6) of positions; NaN where fewer than two of a trial are in a row."""
    states = np.concatenate([positions, np.empty_like(positions)], axis=-1)
    whole = np.isfinite(positions).all(axis=(0, -1))
    alike = [np.flatnonzero(whole), *np.flatnonzero(~whole)[:, None]]  # gaps are each trial's own
    for trials in alike:
        flat = positions[:, trials].reshape(times.size, -1)
        found = polynomial_states(times, flat, times, _ORDER, fewest=2)[:, flat.shape[1] :]
        states[:, trials, 3:] = found.reshape(times.size, trials.size, 3)
    return states


class RecordedTruth(EnsembleBlock):
    """Truth interpolated from a record, for example a navigation log or an aircraft's own reports.

    Ports, all outputs: ``state`` (trials, 6) position [m] and velocity [m/s], in whatever axes the record
    is in; ``acceleration`` (trials, 3) [m/s^2]. Both are NaN outside the record.

    Parameters
    ----------
    times : array_like, shape (samples,)
        Strictly increasing [s], at least two.
    states : array_like, shape (samples, size) or (samples, trials, size)
        ``size`` 6: position and velocity. ``size`` 3: position alone; the velocity is then that of the polynomial
        of order 4 through the five nearest samples, off by h^4/30 times the fifth derivative of the motion, and by
        h^4/5 times it at the ends (an orbit wants more: see `quietfix.systems.plants.sp3`). A NaN sample leaves a gap
        in its trial.
    name : str
        Name of the block.

    Raises
    ------
    ValueError
        For wrong shapes, fewer than two samples, times that do not increase.
    """

    def __init__(self, times: ArrayLike, states: ArrayLike, name: str = "truth") -> None:
        super().__init__(name)
        t, x = np.array(times, dtype=float), np.array(states, dtype=float)
        if t.ndim != 1 or t.size < 2:
            raise ValueError(f"{name} times: shape {t.shape} is not allowed; at least two samples in one dimension")
        if not np.all(np.isfinite(t)):
            raise ValueError(f"{name} times: all must be finite")
        if np.any(np.diff(t) <= 0):
            at = int(np.argmax(np.diff(t) <= 0))
            raise ValueError(f"{name} times: they must increase strictly, but {t[at + 1]} s follows {t[at]} s")
        if x.ndim == 2:
            x = x[:, None]
        if x.ndim != 3 or x.shape[0] != t.size or x.shape[1] == 0 or x.shape[2] not in (3, 6):
            raise ValueError(
                f"{name} states: shape {np.shape(states)} is not allowed; ({t.size}, 6) or "
                f"({t.size}, trials, 6), or the same with 3"
            )
        if x.shape[2] == 3:
            x = _with_velocities(t, x)
        t.setflags(write=False)
        x.setflags(write=False)
        self.times, self.states = t, x
        self.trials = x.shape[1]
        self._at = self.declare_cached("at", RecordedTruth._interpolate, {self.time_ticket()})
        ticket = {self.cached_ticket(self._at)}
        self.declare_output("state", self.trials, 6, self._state, ticket)
        self.declare_output("acceleration", self.trials, 3, self._acceleration, ticket)

    def again(self) -> RecordedTruth:
        """Return such a block for another diagram."""
        return RecordedTruth(self.times, self.states, self.get_name())

    def at(self, time: float) -> Array:
        """Return the states (trials, 6) at a time [s]; NaN outside the record."""
        return hermite(self.times, self.states, time)[0]

    def _interpolate(self, context: Context) -> tuple[Array, Array]:
        return hermite(self.times, self.states, context.get_time())

    def _state(self, context: Context) -> Array:
        return self.cached(context, self._at)[0]

    def _acceleration(self, context: Context) -> Array:
        return self.cached(context, self._at)[1]
