"""Where a line of sight reaches a height above the ellipsoid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.earth.geodetic import vertical

__all__ = ["ray_at_height"]

Array = NDArray[np.float64]

_STEPS = 8  # Newton squares an error of some kilometres, by the ellipsoid's flattening, five times to rounding


def ray_at_height(origin: Array, direction: Array, height: Array) -> Array:
    """Return the nearer point of a ray at a geodetic height, Earth-fixed, shape (..., 3).

    The first guess is on the sphere through the ground below the origin; then Newton's method on the distance.

    Parameters
    ----------
    origin : ndarray, shape (..., 3)
        Earth-fixed position above `height` [m].
    direction : ndarray, shape (..., 3)
        Unit vectors.
    height : ndarray, shape (...)
        Height above the ellipsoid [m].

    Returns
    -------
    ndarray, shape (..., 3)
        NaN where the ray does not come down to that height.
    """
    normal, above = vertical(origin)
    radius = np.sqrt(np.sum(origin * origin, axis=-1)) - above + height
    along = np.sum(origin * direction, axis=-1)
    square = along**2 - np.sum(origin * origin, axis=-1) + radius**2
    distance = -along - np.sqrt(np.where(square >= 0, square, np.nan))
    distance = np.where(distance > 0, distance, np.nan)
    for _ in range(_STEPS):
        point = origin + distance[..., None] * direction
        normal, here = vertical(point)
        distance = distance - (here - height) / np.sum(normal * direction, axis=-1)
    return origin + distance[..., None] * direction
