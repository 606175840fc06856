"""Inertial and Earth-fixed axes, and the body frame of a satellite that points to the centre of the Earth.

Everything works over leading axes: a position is ``(..., 3)``, a state ``(..., 6)`` = position, velocity.
Inertial and Earth-fixed axes coincide at t = 0 and differ by the Earth rotation angle ``earth_rate * t``
about z; precession, nutation and polar motion are left out. Metres, seconds, radians.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.systems.constants import EARTH_RATE

__all__ = [
    "acceleration_to_earth_fixed",
    "acceleration_to_inertial",
    "earth_fixed_to_inertial",
    "inertial_to_earth_fixed",
    "nadir_frame",
    "nadir_frame_earth_fixed",
]

Array = NDArray[np.float64]


# ------------------------------------------------------------------------------------ inertial, Earth-fixed


def _turn(vector: Array, angle: ArrayLike) -> Array:
    """Return the components of `vector` (..., 3) in axes turned by `angle` (...) [rad] about z."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    return np.stack(np.broadcast_arrays(c * x + s * y, c * y - s * x, z), axis=-1)


def _spin(vector: Array, rate: float) -> Array:
    """Return omega x vector, omega = (0, 0, rate)."""
    out = np.zeros_like(vector)
    out[..., 0] = -rate * vector[..., 1]
    out[..., 1] = rate * vector[..., 0]
    return out


def inertial_to_earth_fixed(state: ArrayLike, time: ArrayLike, earth_rate: float = EARTH_RATE) -> Array:
    """Convert inertial states to Earth-fixed ones.

    Parameters
    ----------
    state : array_like, shape (..., 6)
        Inertial position [m] and velocity [m/s].
    time : array_like, shape (...)
        Time [s]; a scalar, or what broadcasts with the leading axes of `state`.
    earth_rate : float
        Rotation rate of the Earth [rad/s].

    Returns
    -------
    ndarray, shape (..., 6)
        Earth-fixed position [m] and velocity relative to the turning axes [m/s]:
        p = C r, v = C r' - omega x p, with C the rotation by ``earth_rate * time`` about z.
    """
    x, angle = np.asarray(state, dtype=float), earth_rate * np.asarray(time, dtype=float)
    position = _turn(x[..., :3], angle)
    return np.concatenate([position, _turn(x[..., 3:6], angle) - _spin(position, earth_rate)], axis=-1)


def earth_fixed_to_inertial(state: ArrayLike, time: ArrayLike, earth_rate: float = EARTH_RATE) -> Array:
    """Convert Earth-fixed states to inertial ones; the inverse of `inertial_to_earth_fixed`.

    Parameters
    ----------
    state : array_like, shape (..., 6)
        Earth-fixed position [m] and velocity [m/s].
    time : array_like, shape (...)
        Time [s]; a scalar, or what broadcasts with the leading axes of `state`.
    earth_rate : float
        Rotation rate of the Earth [rad/s].

    Returns
    -------
    ndarray, shape (..., 6)
        Inertial position [m] and velocity [m/s].
    """
    x, angle = np.asarray(state, dtype=float), -earth_rate * np.asarray(time, dtype=float)
    velocity = x[..., 3:6] + _spin(x[..., :3], earth_rate)
    return np.concatenate([_turn(x[..., :3], angle), _turn(velocity, angle)], axis=-1)


def acceleration_to_earth_fixed(
    acceleration: ArrayLike, state: ArrayLike, time: ArrayLike, earth_rate: float = EARTH_RATE
) -> Array:
    """Convert inertial accelerations to accelerations relative to the Earth-fixed axes.

    Parameters
    ----------
    acceleration : array_like, shape (..., 3)
        Inertial acceleration [m/s^2].
    state : array_like, shape (..., 6)
        Inertial position [m] and velocity [m/s].
    time : array_like, shape (...)
        Time [s]; a scalar, or what broadcasts with the leading axes.
    earth_rate : float
        Rotation rate of the Earth [rad/s].

    Returns
    -------
    ndarray, shape (..., 3)
        C a - 2 omega x v - omega x (omega x p) [m/s^2], p and v Earth-fixed.
    """
    fixed = inertial_to_earth_fixed(state, time, earth_rate)
    turned = _turn(np.asarray(acceleration, dtype=float), earth_rate * np.asarray(time, dtype=float))
    return turned - _apparent(fixed, earth_rate)


def acceleration_to_inertial(
    acceleration: ArrayLike, state: ArrayLike, time: ArrayLike, earth_rate: float = EARTH_RATE
) -> Array:
    """Convert Earth-fixed accelerations to inertial ones; the inverse of `acceleration_to_earth_fixed`.

    Parameters
    ----------
    acceleration : array_like, shape (..., 3)
        Acceleration relative to the Earth-fixed axes [m/s^2].
    state : array_like, shape (..., 6)
        Earth-fixed position [m] and velocity [m/s].
    time : array_like, shape (...)
        Time [s]; a scalar, or what broadcasts with the leading axes.
    earth_rate : float
        Rotation rate of the Earth [rad/s].

    Returns
    -------
    ndarray, shape (..., 3)
        Inertial acceleration [m/s^2].
    """
    whole = np.asarray(acceleration, dtype=float) + _apparent(np.asarray(state, dtype=float), earth_rate)
    return _turn(whole, -earth_rate * np.asarray(time, dtype=float))


def _apparent(fixed: Array, earth_rate: float) -> Array:
    """Return 2 omega x v + omega x (omega x p) for an Earth-fixed state."""
    return _spin(2 * fixed[..., 3:6] + _spin(fixed[..., :3], earth_rate), earth_rate)


# ---------------------------------------------------------------------------------------------- body frames


def nadir_frame(state: ArrayLike) -> Array:
    """Return the rotation from inertial axes to the orbital body frame.

    Parameters
    ----------
    state : array_like, shape (..., 6)
        Inertial position [m] and velocity [m/s].

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Rows are the body axes: x along the inertial velocity (made orthogonal), y across, z to the centre
        of the Earth: z = -r/norm(r), y = z x v normalised, x = y x z.
    """
    x = np.asarray(state, dtype=float)
    return _frame(x[..., :3], x[..., 3:6])


def nadir_frame_earth_fixed(position: ArrayLike, velocity: ArrayLike, earth_rate: float = EARTH_RATE) -> Array:
    """Return the rotation from Earth-fixed axes to the orbital body frame.

    Parameters
    ----------
    position, velocity : array_like, shape (..., 3)
        Earth-fixed position [m] and velocity [m/s].
    earth_rate : float
        Rotation rate of the Earth [rad/s].

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Rows are the body axes of `nadir_frame`, in Earth-fixed axes. The frame follows the *inertial*
        velocity, v + omega x p; no time is needed, because only the directions at this instant matter.
    """
    p = np.asarray(position, dtype=float)
    return _frame(p, np.asarray(velocity, dtype=float) + _spin(p, earth_rate))


def _frame(position: Array, velocity: Array) -> Array:
    z = -position / _norm(position)
    x = velocity - np.einsum("...i,...i->...", velocity, z)[..., None] * z  # y x z = v - (v z) z, made a unit vector
    x = x / _norm(x)
    frame = np.empty((*np.broadcast_shapes(x.shape[:-1], z.shape[:-1]), 3, 3))
    frame[..., 0, :], frame[..., 2, :] = x, z
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        frame[..., 1, i] = z[..., j] * x[..., k] - z[..., k] * x[..., j]
    return frame


def _norm(vector: Array) -> Array:
    return np.sqrt(np.einsum("...i,...i->...", vector, vector))[..., None]
