"""TDOA, FDOA and phase of one target, written for one state vector: what a user of the peers would write.

Nothing here runs over leading axes, and what depends only on the satellites is worked out once per epoch: the
peers are not to lose time on what they do not need.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angles.phase import InterferometerPhase
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.measurement.fdoa import Fdoa
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa

__all__ = ["SingleTarget"]

Array = NDArray[np.float64]


class SingleTarget:
    """Measurement function and Jacobian of one target at one epoch.

    Parameters
    ----------
    stack : Stack
        TDOA, FDOA and two-axis phase, as `three_satellite` has them; wavelength and baseline are read from it.
    platforms : ndarray, shape (3, 6)
        Satellites at this epoch, Earth-fixed.
    speed : float
        What turns metres into the unit of the TDOA: the speed of light for seconds; 1 leaves range differences [m].
    """

    def __init__(self, stack: Stack, platforms: Array, speed: float = SPEED_OF_LIGHT) -> None:
        tdoa, fdoa, phase = stack.models
        assert isinstance(tdoa, Tdoa) and isinstance(fdoa, Fdoa) and isinstance(phase, InterferometerPhase)
        self._positions, self._velocities = platforms[:, :3].copy(), platforms[:, 3:].copy()
        self._speed = speed
        self._per_wavelength = -fdoa.carrier / SPEED_OF_LIGHT
        self._axes = phase.body_axes(platforms)

    def _sight(self, x: Array) -> tuple[Array, Array, Array, Array]:
        offset = x[:3] - self._positions
        distance = np.sqrt((offset * offset).sum(axis=1))
        direction = offset / distance[:, None]
        velocity = x[3:] - self._velocities
        return distance, direction, velocity, (direction * velocity).sum(axis=1)

    def function(self, x: Array) -> Array:
        """Return the measurement, shape (6,), of a state (6,)."""
        distance, direction, _, rate = self._sight(x)
        z = np.empty(6)
        z[:2] = (distance[1:] - distance[0]) / self._speed
        z[2:4] = self._per_wavelength * (rate[1:] - rate[0])
        z[4:] = self._axes @ direction[0]
        return z

    def jacobian(self, x: Array) -> Array:
        """Return its derivative, shape (6, 6)."""
        distance, direction, velocity, rate = self._sight(x)
        turning = (velocity - rate[:, None] * direction) / distance[:, None]
        spread = direction[1:] - direction[0]
        rows = np.zeros((6, 6))
        rows[:2, :3] = spread / self._speed
        rows[2:4, :3] = self._per_wavelength * (turning[1:] - turning[0])
        rows[2:4, 3:] = self._per_wavelength * spread
        phase = self._axes @ direction[0]
        rows[4:, :3] = (self._axes - phase[:, None] * direction[0]) / distance[0]
        return rows
