"""Emitters on a prescribed path: straight line in Earth-fixed axes, great circle at constant height."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import Context

from quietfix.systems.signals import EnsembleBlock
from quietfix.systems.trajectories.gravity import GravityConstants, above_surface
from quietfix.systems.trajectories.great_circle import great_circle, straight_line

__all__ = ["GreatCircle", "StraightLine"]

Array = NDArray[np.float64]

_DEEPEST = 1000.0  # m below the ellipsoid; land and sea go down to -430 m and geoid undulation to -107 m


def check_start(start: ArrayLike) -> Array:
    """Return the start states as (trials, 6), or raise ValueError in the user's words."""
    x = np.array(start, dtype=float)
    if x.ndim == 1:
        x = x[None]
    if x.ndim != 2 or x.shape[-1] != 6 or x.shape[0] == 0:
        raise ValueError(f"emitter start: shape {np.shape(start)} is not allowed; (6,) or (trials, 6)")
    if not np.all(np.isfinite(x)):
        trial = int(np.argwhere(~np.isfinite(x))[0, 0])
        raise ValueError(f"emitter start: trial {trial} has a number that is not finite")
    below = ~above_surface(x[:, :3], GravityConstants(), depth=_DEEPEST)
    if below.any():
        trial = int(np.argmax(below))
        raise ValueError(
            f"emitter start: trial {trial} starts below the Earth's surface, "
            f"{np.linalg.norm(x[trial, :3]):.0f} m from the centre; Earth-fixed metres are expected"
        )
    x.setflags(write=False)
    return x


class StraightLine(EnsembleBlock):
    r"""An emitter on a straight line in Earth-fixed axes.

    Ports, all outputs: ``state`` (trials, 6) Earth-fixed position [m] and velocity [m/s]; ``acceleration``
    (trials, 3) relative to the Earth-fixed axes [m/s^2], zero here.

    .. math:: p(t) = p_0 + v_0 t, \qquad v(t) = v_0

    Parameters
    ----------
    start : array_like, shape (6,) or (trials, 6)
        Earth-fixed state at time 0 (from a place and a course: `quietfix.systems.earth.geodetic.geodetic_state`).
    name : str
        Name of the block.

    Raises
    ------
    ValueError
        For numbers that are not finite and a start deep below the Earth's surface.
    """

    def __init__(self, start: ArrayLike, name: str = "emitter") -> None:
        super().__init__(name)
        self.start = check_start(start)
        self.trials = len(self.start)
        self.declare_output("state", self.trials, 6, self._state, {self.time_ticket()})
        self.declare_output("acceleration", self.trials, 3, self._acceleration, {self.nothing_ticket()})

    def _state(self, context: Context) -> Array:
        return straight_line(self.start, context.get_time())

    def _acceleration(self, context: Context) -> Array:
        return np.zeros((self.trials, 3))


class GreatCircle(EnsembleBlock):
    r"""An emitter at constant height along a great circle; see `great_circle`.

    Ports, all outputs: ``state`` (trials, 6) Earth-fixed position [m] and velocity [m/s]; ``acceleration``
    (trials, 3) relative to the Earth-fixed axes [m/s^2].

    .. math:: n(t) = n_0\cos\omega t + m\sin\omega t, \qquad p = a D n/\sqrt{1 - e^2 n_z^2} + h n, \qquad
              D = \mathrm{diag}(1, 1, 1 - e^2)

    Parameters
    ----------
    start : array_like, shape (6,) or (trials, 6)
        Earth-fixed state at time 0, level.
    name : str
        Name of the block.

    Raises
    ------
    ValueError
        For numbers that are not finite, a start deep below the Earth's surface, a start that climbs or
        descends.
    """

    def __init__(self, start: ArrayLike, name: str = "emitter") -> None:
        super().__init__(name)
        self.start = check_start(start)
        self.trials = len(self.start)
        self._path = great_circle(self.start)
        self.declare_output("state", self.trials, 6, self._state, {self.time_ticket()})
        self.declare_output("acceleration", self.trials, 3, self._acceleration, {self.time_ticket()})

    def _state(self, context: Context) -> Array:
        return self._path.state(context.get_time())

    def _acceleration(self, context: Context) -> Array:
        return self._path.acceleration(context.get_time())
