"""Geodetic coordinates on the WGS-84 ellipsoid, courses over it, and Earth-fixed positions and velocities.

Everything works over leading axes, in metres, seconds and radians.
"""

from __future__ import annotations

import numpy as np
import pymap3d
from numpy.typing import ArrayLike, NDArray

from quietfix.systems.constants import WGS84_AXIS, WGS84_ECCENTRICITY_SQUARED, WGS84_FLATTENING

__all__ = [
    "course_speed",
    "course_velocity",
    "ecef_to_geodetic",
    "enu_offset",
    "enu_rotation",
    "geodetic_state",
    "geodetic_to_ecef",
    "up",
    "vertical",
]

Array = NDArray[np.float64]


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


def enu_offset(position: Array, origin: Array) -> Array:
    """Return east, north and up [m] from a place `origin` (3,) of Earth-fixed positions (..., 3)."""
    turn = enu_rotation(*ecef_to_geodetic(origin)[:2])
    return np.einsum("ij,...j->...i", turn, position - origin)


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
