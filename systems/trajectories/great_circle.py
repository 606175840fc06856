"""Straight line and great circle: Earth-fixed paths as functions of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.systems.constants import WGS84_AXIS, WGS84_ECCENTRICITY_SQUARED
from quietfix.systems.earth.geodetic import course_speed, ecef_to_geodetic, enu_rotation

__all__ = ["GreatCirclePath", "great_circle", "level_state", "straight_line"]

Array = NDArray[np.float64]

_LEVEL = 1e-3  # m/s; a level start given by course and speed climbs by rounding error only


def straight_line(start: ArrayLike, time: ArrayLike) -> Array:
    """Return the state on a straight line in Earth-fixed axes.

    Parameters
    ----------
    start : array_like, shape (..., 6)
        Earth-fixed position [m] and velocity [m/s] at time 0.
    time : array_like, shape (...)
        Time [s]; a scalar, or what broadcasts with the leading axes of `start`.

    Returns
    -------
    ndarray, shape (..., 6)
        Earth-fixed position [m] and velocity [m/s].
    """
    x = np.asarray(start, dtype=float)
    position = x[..., :3] + np.asarray(time, dtype=float)[..., None] * x[..., 3:6]
    return np.concatenate(np.broadcast_arrays(position, x[..., 3:6]), axis=-1)


@dataclass(frozen=True, eq=False)
class GreatCirclePath:
    """Constant height above the WGS-84 ellipsoid along a great circle; see `great_circle`.

    Parameters
    ----------
    normal, tangent : ndarray, shape (..., 3)
        Ellipsoid normal at time 0 and the unit vector in which it starts to turn (zero for a body at rest).
    rate : ndarray, shape (...)
        Rate at which the normal turns [rad/s].
    height : ndarray, shape (...)
        Height above the ellipsoid [m].
    """

    normal: Array
    tangent: Array
    rate: Array
    height: Array

    def _turned(self, time: ArrayLike) -> tuple[Array, Array, Array]:
        rate = self.rate[..., None]
        angle = rate * np.asarray(time, dtype=float)[..., None]
        c, s = np.cos(angle), np.sin(angle)
        normal = c * self.normal + s * self.tangent
        return normal, rate * (c * self.tangent - s * self.normal), -(rate**2) * normal

    def state(self, time: ArrayLike) -> Array:
        """Return the Earth-fixed state.

        Parameters
        ----------
        time : array_like, shape (...)
            Time [s]; a scalar, or what broadcasts with the leading axes.

        Returns
        -------
        ndarray, shape (..., 6)
            Earth-fixed position [m] and velocity [m/s].
        """
        n, dn, _ = self._turned(time)
        return level_state(n, dn, self.height)

    def acceleration(self, time: ArrayLike) -> Array:
        """Return the acceleration relative to the Earth-fixed axes.

        Parameters
        ----------
        time : array_like, shape (...)
            Time [s]; a scalar, or what broadcasts with the leading axes.

        Returns
        -------
        ndarray, shape (..., 3)
            Acceleration [m/s^2].
        """
        n, dn, ddn = self._turned(time)
        g, dg, ddg = _curvature(n, dn, ddn)
        return _squash(ddn * g + 2 * dn * dg + n * ddg) + self.height[..., None] * ddn


def great_circle(start: ArrayLike) -> GreatCirclePath:
    """Return the path of constant height that begins with a level state.

    Parameters
    ----------
    start : array_like, shape (..., 6)
        Earth-fixed position [m] and velocity [m/s] at time 0; the velocity must be level.

    Returns
    -------
    GreatCirclePath

    Raises
    ------
    ValueError
        If the start climbs or descends.

    Notes
    -----
    The *normal of the ellipsoid* at the body, n, turns at a constant rate about a fixed axis through the
    centre of the Earth; with the height h fixed the position is p = a D n / sqrt(1 - e^2 n_z^2) + h n, D =
    diag(1, 1, 1 - e^2). The height above the ellipsoid is then exactly constant, which a circle about the
    centre of the Earth does not give (it rises or falls by up to 3.4 m per km of northing). The speed is
    the start's and follows the radius of curvature afterwards, within 1 % over the whole Earth.
    """
    x = np.asarray(start, dtype=float)
    lat, lon, height = ecef_to_geodetic(x[..., :3])
    climb = course_speed(x[..., :3], x[..., 3:6])[2]
    if np.any(np.abs(climb) > _LEVEL):
        worst = climb.flat[np.argmax(np.abs(climb))]
        raise ValueError(f"start: it climbs at {worst:.3g} m/s; a great circle keeps its height and must start level")
    axes = enu_rotation(lat, lon)
    local = (axes @ x[..., 3:6, None])[..., 0]
    root = np.sqrt(1 - WGS84_ECCENTRICITY_SQUARED * np.sin(lat) ** 2)
    prime = WGS84_AXIS / root
    meridian = prime * (1 - WGS84_ECCENTRICITY_SQUARED) / root**2
    turn = (local[..., 0] / (prime + height))[..., None] * axes[..., 0, :]
    turn = turn + (local[..., 1] / (meridian + height))[..., None] * axes[..., 1, :]
    rate = np.linalg.norm(turn, axis=-1)
    tangent = turn / np.where(rate > 0, rate, 1.0)[..., None]
    return GreatCirclePath(axes[..., 2, :], tangent, rate, height)


def level_state(normal: Array, rate: Array, height: Array) -> Array:
    """Return Earth-fixed states (..., 6) of what keeps its height above the ellipsoid.

    Parameters
    ----------
    normal, rate : ndarray, shape (..., 3)
        Normal of the ellipsoid below it, and its time derivative [1/s].
    height : ndarray, shape (...)
        [m]
    """
    g, dg, _ = _curvature(normal, rate)
    h = height[..., None]
    return np.concatenate([_squash(normal) * g + h * normal, _squash(rate * g + normal * dg) + h * rate], axis=-1)


def _squash(vector: Array) -> Array:
    return WGS84_AXIS * vector * np.array([1.0, 1.0, 1 - WGS84_ECCENTRICITY_SQUARED])


def _curvature(n: Array, dn: Array, ddn: Array | None = None) -> tuple[Array, Array, Array]:
    """Return g = (1 - e^2 n_z^2)^(-1/2) and its first two time derivatives, shape (..., 1)."""
    e2, z, dz = WGS84_ECCENTRICITY_SQUARED, n[..., 2:3], dn[..., 2:3]
    g = 1 / np.sqrt(1 - e2 * z**2)
    dg = e2 * z * dz * g**3
    ddz = 0.0 if ddn is None else ddn[..., 2:3]
    return g, dg, e2 * (dz**2 + z * ddz) * g**3 + 3 * (e2 * z * dz) ** 2 * g**5
