r"""How far a wave goes between two places on the ground: along it, or by the ionosphere.

Along the ground a wave follows the curvature, in air of the mean refractivity of the surface:
:math:`L = (1 + N_0)\,2R\arcsin(d/2R)`, d the chord. One hop by a mirror at height h over a sphere
(Davies, *Ionospheric Radio*, 1990, section 6.2): :math:`L = 2\sqrt{R^2 + (R+h)^2 - 2R(R+h)\cos(D/2R)}`, D the arc.

A sphere of the Earth's mean radius is meant: over 1000 km the arc is off by some 10 m where the radius of curvature is
0.5 % another one, and less than 3 m over 500 km.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.systems.geometry.refractivity import mean_refractivity

__all__ = ["WavePath", "hop_excess", "mirror_height", "sun_elevation"]

Array = NDArray[np.float64]

_RADIUS = 6371008.8  # m; mean radius of the ellipsoid
_LONGEST = 0.999  # of the Earth's diameter
_J2000 = 946728000.0  # 2000-01-01T12:00:00 UTC in seconds since 1970
_DAY = 86400.0


@dataclass(frozen=True)
class WavePath:
    """Length of the path between two places on the ground as a function of their straight distance.

    Parameters
    ----------
    mirror : float
        Height of the layer by which the wave goes in one hop [m]; 0: it goes along the ground.
    """

    mirror: float = 0.0

    def length(self, chord: ArrayLike) -> Array:
        """Return the length [m] of the path over a chord [m], shape (...)."""
        return self._both(chord)[0]

    def slope(self, chord: ArrayLike) -> Array:
        """Return its derivative with respect to the chord, shape (...)."""
        return self._both(chord)[1]

    def _both(self, chord: ArrayLike) -> tuple[Array, Array]:
        # beyond the diameter a search may come by; there is no place there
        half = np.minimum(np.asarray(chord, dtype=float) / (2 * _RADIUS), _LONGEST)
        turn = np.sqrt(1 - np.square(half))
        if not self.mirror:
            air = 1 + float(mean_refractivity(0.0, 0.0))
            return air * 2 * _RADIUS * np.arcsin(half), air / turn
        # cos(D / 2R) is `turn`; R^2 + (R + h)^2 - 2 R (R + h) turn without the difference of large numbers
        top = _RADIUS + self.mirror
        leg = np.sqrt(self.mirror**2 + 2 * _RADIUS * top * np.square(half) / (1 + turn))
        return 2 * leg, top * half / (turn * leg)


def hop_excess(chord: ArrayLike, mirror: ArrayLike) -> Array:
    """Return by how much the way by a mirror is longer than that along the ground [m], shape (...).

    In as few hops as the horizon allows: one reaches at most as far as where the wave leaves the ground level.

    Parameters
    ----------
    chord : array_like, shape (...)
        Straight distance of the two places [m].
    mirror : array_like, shape (...)
        Height of the layer [m], > 0.
    """
    straight, height = np.broadcast_arrays(np.asarray(chord, dtype=float), np.asarray(mirror, dtype=float))
    arc = 2 * np.arcsin(np.minimum(straight / (2 * _RADIUS), _LONGEST))
    hops = np.maximum(np.ceil(arc / (2 * np.arccos(_RADIUS / (_RADIUS + height)))), 1.0)
    half = np.sin(arc / (2 * hops) / 2)
    top = _RADIUS + height
    leg = np.sqrt(np.square(height) + 4 * _RADIUS * top * np.square(half))
    return 2 * hops * leg - WavePath().length(straight)


def mirror_height(frequency: float, day: bool) -> float:
    """Return the height of the layer that usually reflects a wave [m].

    Up to 300 kHz 70 km by day and 90 km by night (Recommendation ITU-R P.684), up to 2 MHz the E layer at 100 km
    (P.1147), above that the F2 layer, at 300 km (P.533).
    """
    if frequency > 2e6:
        return 300e3
    if frequency > 300e3:
        return 100e3
    return 70e3 if day else 90e3


def sun_elevation(latitude: ArrayLike, longitude: ArrayLike, posix: float) -> Array:
    """Return how high the Sun is [rad] at places [rad] and a time [s since 1970, UTC].

    The low-precision formulae of the *Astronomical Almanac* (page C5), good to 0.01 degrees until 2050.
    """
    days = (posix - _J2000) / _DAY
    anomaly = np.radians(357.528 + 0.9856003 * days)
    ecliptic = np.radians(280.460 + 0.9856474 * days + 1.915 * np.sin(anomaly) + 0.020 * np.sin(2 * anomaly))
    obliquity = np.radians(23.439 - 4e-7 * days)
    ascension = np.arctan2(np.cos(obliquity) * np.sin(ecliptic), np.cos(ecliptic))
    declination = np.arcsin(np.sin(obliquity) * np.sin(ecliptic))
    sidereal = np.radians(280.46062 + 360.98564737 * days)
    hour = sidereal + np.asarray(longitude, dtype=float) - ascension
    phi = np.asarray(latitude, dtype=float)
    return np.arcsin(np.sin(phi) * np.sin(declination) + np.cos(phi) * np.cos(declination) * np.cos(hour))
