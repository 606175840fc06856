"""The body frame of a platform that points to nadir, in Earth-fixed axes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.constants import EARTH_RATE
from quietfix.systems.earth.frames import nadir_frame_earth_fixed

__all__ = ["NadirAxes", "body_frame"]

Array = NDArray[np.float64]


def body_frame(platforms: Array, platform: int, earth_rate: float = EARTH_RATE) -> Array:
    """Return the body axes of one of platforms (..., p, >= 6), shape (..., 3, 3), read-only.

    Rows: x along the *inertial* velocity, y = z x x, z to nadir; see
    `quietfix.systems.earth.frames.nadir_frame_earth_fixed`.

    Parameters
    ----------
    platforms : ndarray, shape (..., p, >= 6)
        Earth-fixed position [m] and velocity [m/s].
    platform : int
        Which one.
    earth_rate : float
        Earth rotation [rad/s], to turn Earth-fixed into inertial velocity.
    """
    own = np.ascontiguousarray(platforms[..., platform, :6])
    return _frame(own.tobytes(), own.shape, earth_rate)


@dataclass(frozen=True)
class NadirAxes:
    """The body axes of a satellite that points to nadir, as a function of its state; see `body_frame`.

    Attributes
    ----------
    earth_rate : float
        Earth rotation [rad/s].
    """

    earth_rate: float = EARTH_RATE

    def __call__(self, platform: Array) -> Array:
        """Return the axes as rows (..., 3, 3) of a platform (..., 6)."""
        return body_frame(platform[..., None, :], 0, self.earth_rate)


@lru_cache(maxsize=4)
def _frame(states: bytes, shape: tuple[int, ...], earth_rate: float) -> Array:
    """Return the frame of platforms (..., 6); all iterations of all filters ask for that of one instant."""
    state = np.frombuffer(states).reshape(shape)
    frame = nadir_frame_earth_fixed(state[..., :3], state[..., 3:], earth_rate)
    frame.setflags(write=False)
    return frame
