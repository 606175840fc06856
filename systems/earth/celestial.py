"""Earth-fixed axes against celestial ones: precession, nutation, sidereal time.

The equinox-based reduction of the IAU: precession of 1976 and nutation of 1980, as in Vallado, *Fundamentals of
Astrodynamics and Applications* (4th ed., section 3.7), and *Explanatory Supplement to the Astronomical Almanac* (1992,
sections 3.21 and 3.22), with the 31 largest terms of the nutation: those that are left out add up to 0.02 arcseconds
at most, 0.7 m at 7000 km. Left out are also the motion of the pole (0.5 arcseconds, 17 m at 7000 km, at most) and the
frame bias between EME2000 and GCRF (0.02 arcseconds, 0.8 m), so that both are the same here.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.systems.constants import EARTH_RATE

__all__ = ["equinox_to_earth_fixed", "j2000_to_earth_fixed"]

Array = NDArray[np.float64]

_ARCSECOND = np.pi / 648000
_DAY = 86400.0
_CENTURY = 36525 * _DAY
_NOON_2000 = 946728000  # 2000-01-01T12:00:00 in seconds since 1970, of whatever scale

# Multiples of l, l', F, D, Omega; amplitudes of longitude (and its rate per century) and of obliquity [1e-4 arcseconds]
_TERMS = np.array(
    [
        [0, 0, 0, 0, 1, -171996, -174.2, 92025, 8.9],
        [0, 0, 2, -2, 2, -13187, -1.6, 5736, -3.1],
        [0, 0, 2, 0, 2, -2274, -0.2, 977, -0.5],
        [0, 0, 0, 0, 2, 2062, 0.2, -895, 0.5],
        [0, 1, 0, 0, 0, 1426, -3.4, 54, -0.1],
        [1, 0, 0, 0, 0, 712, 0.1, -7, 0],
        [0, 1, 2, -2, 2, -517, 1.2, 224, -0.6],
        [0, 0, 2, 0, 1, -386, -0.4, 200, 0],
        [1, 0, 2, 0, 2, -301, 0, 129, -0.1],
        [0, -1, 2, -2, 2, 217, -0.5, -95, 0.3],
        [1, 0, 0, -2, 0, -158, 0, -1, 0],
        [0, 0, 2, -2, 1, 129, 0.1, -70, 0],
        [-1, 0, 2, 0, 2, 123, 0, -53, 0],
        [1, 0, 0, 0, 1, 63, 0.1, -33, 0],
        [0, 0, 0, 2, 0, 63, 0, -2, 0],
        [-1, 0, 2, 2, 2, -59, 0, 26, 0],
        [-1, 0, 0, 0, 1, -58, -0.1, 32, 0],
        [1, 0, 2, 0, 1, -51, 0, 27, 0],
        [2, 0, 0, -2, 0, 48, 0, 1, 0],
        [-2, 0, 2, 0, 1, 46, 0, -24, 0],
        [0, 0, 2, 2, 2, -38, 0, 16, 0],
        [2, 0, 2, 0, 2, -31, 0, 13, 0],
        [2, 0, 0, 0, 0, 29, 0, -1, 0],
        [1, 0, 2, -2, 2, 29, 0, -12, 0],
        [0, 0, 2, 0, 0, 26, 0, -1, 0],
        [0, 0, 2, -2, 0, -22, 0, 0, 0],
        [-1, 0, 2, 0, 1, 21, 0, -10, 0],
        [0, 2, 0, 0, 0, 17, -0.1, 0, 0],
        [0, 2, 2, -2, 2, -16, 0.1, 7, 0],
        [-1, 0, 0, 2, 1, 16, 0, -8, 0],
        [0, 1, 0, 0, 1, -15, 0, 9, 0],
    ]
)


def _about(axis: int, angle: Array) -> Array:
    """Return matrices (k, 3, 3) that turn the axes about x (0), y (1) or z (2)."""
    c, s = np.cos(angle), np.sin(angle)
    found = np.zeros((angle.size, 3, 3))
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    found[:, axis, axis] = 1.0
    found[:, i, i] = found[:, j, j] = c
    found[:, i, j], found[:, j, i] = s, -s
    return found


def _precession(t: Array) -> Array:
    """Return matrices from the mean equator and equinox of 2000 to those of date, of centuries of TT (Lieske, 1977)."""
    zeta = _ARCSECOND * (2306.2181 * t + 0.30188 * t**2 + 0.017998 * t**3)
    theta = _ARCSECOND * (2004.3109 * t - 0.42665 * t**2 - 0.041833 * t**3)
    z = _ARCSECOND * (2306.2181 * t + 1.09468 * t**2 + 0.018203 * t**3)
    return _about(2, -z) @ _about(1, theta) @ _about(2, -zeta)


def _nutation(t: Array) -> tuple[Array, Array]:
    """Return matrices from mean to true equator and equinox of date, and the equation of the equinoxes [rad]."""
    turn = 1296000.0
    arguments = np.stack(
        [
            485866.733 + (1325 * turn + 715922.633) * t + 31.310 * t**2 + 0.064 * t**3,
            1287099.804 + (99 * turn + 1292581.224) * t - 0.577 * t**2 - 0.012 * t**3,
            335778.877 + (1342 * turn + 295263.137) * t - 13.257 * t**2 + 0.011 * t**3,
            1072261.307 + (1236 * turn + 1105601.328) * t - 6.891 * t**2 + 0.019 * t**3,
            450160.280 - (5 * turn + 482890.539) * t + 7.455 * t**2 + 0.008 * t**3,
        ]
    )
    angle = _ARCSECOND * np.mod(_TERMS[:, :5] @ arguments, turn)
    longitude = 1e-4 * _ARCSECOND * np.sum((_TERMS[:, 5:6] + _TERMS[:, 6:7] * t) * np.sin(angle), axis=0)
    obliquity = 1e-4 * _ARCSECOND * np.sum((_TERMS[:, 7:8] + _TERMS[:, 8:9] * t) * np.cos(angle), axis=0)
    mean = _ARCSECOND * (84381.448 - 46.8150 * t - 0.00059 * t**2 + 0.001813 * t**3)
    node = _ARCSECOND * arguments[4]  # of the Moon; its two terms belong to sidereal time since 1997
    more = _ARCSECOND * (0.00264 * np.sin(node) + 0.000063 * np.sin(2 * node))
    turned = _about(0, -(mean + obliquity)) @ _about(2, -longitude) @ _about(0, mean)
    return turned, longitude * np.cos(mean) + more


def _mean_sidereal_time(second: NDArray[np.int64], rest: Array) -> Array:
    """Return Greenwich mean sidereal time [rad] of UT1 as seconds since 1970 (Aoki and others, 1982)."""
    whole = second - _NOON_2000
    t = (whole + rest) / _CENTURY
    day = np.mod(whole, int(_DAY)) + rest  # the Earth's own turn, apart from what grows slowly: no digit is lost
    slow = 67310.54841 - 43200.0 + 8640184.812866 * t + 0.093104 * t**2 - 6.2e-6 * t**3
    return 2 * np.pi * np.mod(np.mod(slow, _DAY) + day + 43200.0, _DAY) / _DAY


def equinox_to_earth_fixed(state: ArrayLike, second: ArrayLike, rest: ArrayLike) -> Array:
    """Return Earth-fixed states of states in true-equator, mean-equinox axes of date (TEME, those of SGP4).

    Parameters
    ----------
    state : array_like, shape (k, 6)
        Position [m] and velocity [m/s].
    second, rest : array_like, shape (k,)
        UT1 as seconds since 1970, whole ones and the rest [s].

    Returns
    -------
    ndarray, shape (k, 6)
        Position, and velocity relative to the Earth.
    """
    whole, part = np.atleast_1d(np.asarray(second, dtype=np.int64)), np.atleast_1d(np.asarray(rest, dtype=float))
    return _spun(np.atleast_2d(np.asarray(state, dtype=float)), _about(2, _mean_sidereal_time(whole, part)))


def _spun(state: Array, turn: Array) -> Array:
    """Return states in turned axes, their velocities relative to the Earth."""
    position = np.einsum("kij,kj->ki", turn, state[:, :3])
    velocity = np.einsum("kij,kj->ki", turn, state[:, 3:])
    velocity[:, 0] += EARTH_RATE * position[:, 1]
    velocity[:, 1] -= EARTH_RATE * position[:, 0]
    return np.concatenate([position, velocity], axis=-1)


def j2000_to_earth_fixed(state: ArrayLike, tai: ArrayLike, second: ArrayLike, rest: ArrayLike) -> Array:
    """Return Earth-fixed states of states in EME2000 (J2000), which GCRF is within 0.02 arcseconds.

    Parameters
    ----------
    state : array_like, shape (k, 6)
        Position [m] and velocity [m/s].
    tai : array_like, shape (k,)
        TAI as seconds since 1970-01-01T00:00:00 TAI.
    second, rest : array_like, shape (k,)
        UT1 as seconds since 1970, whole ones and the rest [s].

    Returns
    -------
    ndarray, shape (k, 6)
        Position, and velocity relative to the Earth.
    """
    whole, part = np.atleast_1d(np.asarray(second, dtype=np.int64)), np.atleast_1d(np.asarray(rest, dtype=float))
    centuries = (np.atleast_1d(np.asarray(tai, dtype=float)) + 32.184 - _NOON_2000) / _CENTURY
    nutation, equinoxes = _nutation(centuries)
    spin = _about(2, _mean_sidereal_time(whole, part) + equinoxes)
    return _spun(np.atleast_2d(np.asarray(state, dtype=float)), spin @ nutation @ _precession(centuries))
