"""Frames: WGS-84 geodetic, Earth-fixed, inertial, local east-north-up and the nadir body frame.

Everything works over leading axes: a position is ``(..., 3)``, a state ``(..., 6)`` = position, velocity.
Inertial and Earth-fixed axes coincide at t = 0 and differ by the Earth rotation angle ``earth_rate * t``
about z; precession, nutation and polar motion are left out. Metres, seconds, radians.
"""

from __future__ import annotations

import numpy as np
import pymap3d
from numpy.typing import ArrayLike, NDArray

from systems.constants import EARTH_RATE, WGS84_AXIS, WGS84_ECCENTRICITY_SQUARED, WGS84_FLATTENING

__all__ = [
    "acceleration_to_earth_fixed",
    "acceleration_to_inertial",
    "course_speed",
    "course_velocity",
    "earth_fixed_to_inertial",
    "ecef_to_geodetic",
    "enu_rotation",
    "geodetic_state",
    "geodetic_to_ecef",
    "inertial_to_earth_fixed",
    "nadir_frame",
    "nadir_frame_earth_fixed",
    "up",
    "vertical",
]

Array = NDArray[np.float64]

# ------------------------------------------------------------------------------------------------- geodetic


def geodetic_to_ecef(latitude: ArrayLike, longitude: ArrayLike, height: ArrayLike) -> Array:
    """Convert geodetic coordinates to an Earth-fixed position, by pymap3d.

    Parameters
    ----------
    latitude, longitude : array_like, shape (...)
        Geodetic latitude and longitude [rad]; the three arguments broadcast.
    height : array_like, shape (...)
        Height above the WGS-84 ellipsoid [m].

    Returns
    -------
    ndarray, shape (..., 3)
        Earth-fixed position [m].
    """
    lat, lon, h = np.broadcast_arrays(*(np.asarray(a, dtype=float) for a in (latitude, longitude, height)))
    return np.stack(pymap3d.geodetic2ecef(lat, lon, h, deg=False), axis=-1)


def ecef_to_geodetic(position: ArrayLike) -> tuple[Array, Array, Array]:
    """Convert an Earth-fixed position to geodetic coordinates.

    Parameters
    ----------
    position : array_like, shape (..., 3)
        Earth-fixed position [m].

    Returns
    -------
    latitude, longitude, height : ndarray, shape (...)
        Geodetic latitude and longitude [rad], height above the WGS-84 ellipsoid [m].

    Notes
    -----
    pymap3d's closed form is not exact away from the ellipsoid (2 mm at 700 km, 30 m at 20 000 km), so one
    step of Bowring's iteration follows (*Survey Review* 23, 1976, p. 323), which leaves rounding error.
    """
    p = np.asarray(position, dtype=float)
    # pymap3d squeezes its result, hence flat arrays and a reshape
    x, y, z = (np.ascontiguousarray(p[..., i]).ravel() for i in range(3))
    lat, lon, _ = (np.reshape(a, x.shape) for a in pymap3d.ecef2geodetic(x, y, z, deg=False))
    lat, h = _bowring(np.hypot(x, y), z, lat)
    shape = p.shape[:-1]
    return lat.reshape(shape), lon.reshape(shape), h.reshape(shape)


def _bowring(rho: Array, z: Array, latitude: Array) -> tuple[Array, Array]:
    a, e2 = WGS84_AXIS, WGS84_ECCENTRICITY_SQUARED
    b = a * (1 - WGS84_FLATTENING)
    reduced = np.arctan2((1 - WGS84_FLATTENING) * np.sin(latitude), np.cos(latitude))
    lat = np.arctan2(z + e2 / (1 - e2) * b * np.sin(reduced) ** 3, rho - e2 * a * np.cos(reduced) ** 3)
    sine = np.sin(lat)
    return lat, rho * np.cos(lat) + z * sine - a * np.sqrt(1 - e2 * sine**2)


def vertical(position: ArrayLike) -> tuple[Array, Array]:
    """Return the outward normal of the ellipsoid and the height above it: what filters ask for at every step.

    Parameters
    ----------
    position : array_like, shape (..., 3)
        Earth-fixed position [m], not at the Earth's centre.

    Returns
    -------
    up : ndarray, shape (..., 3)
        Unit vector; the gradient of the height.
    height : ndarray, shape (...)
        Height above the WGS-84 ellipsoid [m].

    Notes
    -----
    Bowring's iteration on the reduced latitude (*Survey Review* 23, 1976, p. 323) without angles: two steps leave
    rounding error from 100 km below the ellipsoid to the geostationary ring, in a fifth of the time of
    `ecef_to_geodetic`.
    """
    p = np.asarray(position, dtype=float)
    a, e2 = WGS84_AXIS, WGS84_ECCENTRICITY_SQUARED
    b = a * (1 - WGS84_FLATTENING)
    x, y, z = p[..., 0], p[..., 1], p[..., 2]
    rho = np.sqrt(x * x + y * y)
    cosine, sine = (1 - WGS84_FLATTENING) * rho, z
    for _ in range(2):
        size = np.sqrt(cosine * cosine + sine * sine)
        cosine, sine = cosine / size, sine / size
        level = rho - (e2 * a) * (cosine * cosine * cosine)
        axial = z + (e2 / (1 - e2) * b) * (sine * sine * sine)
        cosine, sine = level, (1 - WGS84_FLATTENING) * axial
    size = np.sqrt(level * level + axial * axial)
    cosine, sine = level / size, axial / size
    normal = np.empty(p.shape)
    normal[..., 2] = sine
    scale = cosine / np.where(rho == 0, 1.0, rho)
    normal[..., 0], normal[..., 1] = x * scale, y * scale
    return normal, rho * cosine + z * sine - a * np.sqrt(1 - e2 * (sine * sine))


def up(position: ArrayLike) -> Array:
    """Return the outward normal of the ellipsoid: the gradient of the height.

    Parameters
    ----------
    position : array_like, shape (..., 3)
        Earth-fixed position [m].

    Returns
    -------
    ndarray, shape (..., 3)
        Unit vector, dh/dp at `position`.
    """
    return vertical(position)[0]


def enu_rotation(latitude: ArrayLike, longitude: ArrayLike) -> Array:
    """Return the rotation from Earth-fixed to local east-north-up axes.

    Parameters
    ----------
    latitude, longitude : array_like, shape (...)
        Geodetic latitude and longitude of the origin [rad].

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Rows are the unit vectors east, north and up in Earth-fixed axes.
    """
    lat, lon = np.broadcast_arrays(np.asarray(latitude, dtype=float), np.asarray(longitude, dtype=float))
    sp, cp, sl, cl = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    rows = [-sl, cl, np.zeros_like(sl), -sp * cl, -sp * sl, cp, cp * cl, cp * sl, sp]
    return np.stack(rows, axis=-1).reshape(*lat.shape, 3, 3)


def course_velocity(
    latitude: ArrayLike, longitude: ArrayLike, course: ArrayLike, speed: ArrayLike, climb: ArrayLike = 0.0
) -> Array:
    """Return the Earth-fixed velocity of something on a course.

    Parameters
    ----------
    latitude, longitude : array_like, shape (...)
        Where it is [rad]; all arguments broadcast.
    course : array_like, shape (...)
        Clockwise from north [rad].
    speed : array_like, shape (...)
        Horizontal speed [m/s].
    climb : array_like, shape (...)
        Vertical speed, up positive [m/s].

    Returns
    -------
    ndarray, shape (..., 3)
        Earth-fixed velocity [m/s].
    """
    course, speed, climb = (np.asarray(a, dtype=float) for a in (course, speed, climb))
    local = np.broadcast_arrays(speed * np.sin(course), speed * np.cos(course), climb)
    # a row vector times the rotation is the transposed rotation times the vector: local to Earth-fixed
    return (np.stack(local, axis=-1)[..., None, :] @ enu_rotation(latitude, longitude))[..., 0, :]


def course_speed(position: ArrayLike, velocity: ArrayLike) -> tuple[Array, Array, Array]:
    """Return course, horizontal speed and climb of an Earth-fixed velocity.

    Parameters
    ----------
    position, velocity : array_like, shape (..., 3)
        Earth-fixed position [m] and velocity [m/s].

    Returns
    -------
    course, speed, climb : ndarray, shape (...)
        Course clockwise from north in [0, 2 pi) [rad], horizontal and vertical speed [m/s].
    """
    lat, lon, _ = ecef_to_geodetic(position)
    local = (enu_rotation(lat, lon) @ np.asarray(velocity, dtype=float)[..., None])[..., 0]
    east, north = local[..., 0], local[..., 1]
    course = np.mod(np.arctan2(east, north), 2 * np.pi)
    return np.where(course >= 2 * np.pi, 0.0, course), np.hypot(east, north), local[..., 2]


def geodetic_state(
    latitude: ArrayLike,
    longitude: ArrayLike,
    height: ArrayLike,
    course: ArrayLike,
    speed: ArrayLike,
    climb: ArrayLike = 0.0,
) -> Array:
    """Return the Earth-fixed state of something at a geodetic place on a course.

    Parameters
    ----------
    latitude, longitude, height, course, speed, climb : array_like, shape (...)
        See `geodetic_to_ecef` and `course_velocity`; all broadcast.

    Returns
    -------
    ndarray, shape (..., 6)
        Earth-fixed position [m] and velocity [m/s].
    """
    position = geodetic_to_ecef(latitude, longitude, height)
    velocity = course_velocity(latitude, longitude, course, speed, climb)
    return np.concatenate(np.broadcast_arrays(position, velocity), axis=-1)


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
