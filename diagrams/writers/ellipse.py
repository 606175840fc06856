"""Error ellipses on the Earth."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.constants import WGS84_AXIS, WGS84_ECCENTRICITY_SQUARED
from quietfix.systems.earth.geodetic import enu_rotation

__all__ = ["axes_of", "ellipse_ring"]

Array = NDArray[np.float64]

_POINTS = 64
_FARTHEST = 0.5 * math.pi  # a quarter of the way around the Earth
_SMALLEST = 1e-2  # m: a line or a point would be no polygon


def axes_of(covariance: Array) -> tuple[Array, Array]:
    """Return standard deviations along the principal axes [m], the larger one last, and the axes as columns.

    Parameters
    ----------
    covariance : ndarray, shape (2, 2)
        East and north [m^2].

    Raises
    ------
    ValueError
        If a variance along an axis is negative by more than rounding.
    """
    variances, axes = np.linalg.eigh(0.5 * (covariance + covariance.T))
    if variances[0] < -1e-9 * max(variances[1], 0.0) or variances[1] < 0:
        raise ValueError(f"covariance {covariance.tolist()} is not allowed; no variance below 0 in any direction")
    return np.sqrt(np.maximum(variances, 0.0)), axes


def ellipse_ring(latitude: float, longitude: float, height: float, covariance: Array) -> tuple[Array, bool]:
    r"""Return the ellipse :math:`d^T P^{-1} d = 1` about a place as a closed ring, counter-clockwise.

    A point of it is :math:`d = \sigma_1 a_1 \cos\alpha + \sigma_2 a_2 \sin\alpha` (east, north) with the principal axes
    a. On the ellipsoid a way d turns the normal by :math:`d_N/(M + h)` towards north and :math:`d_E/(N + h)` towards
    east, M and N the radii of curvature in the meridian and in the prime vertical (Torge, *Geodesy*, 3rd ed., section
    4.1); the normal is turned by both at once, along the great circle of normals. That is exact to first order, has no
    singularity at the poles or at the date line, and the longitudes and latitudes are those of the normal.

    Parameters
    ----------
    latitude, longitude : float
        [deg]
    height : float
        Above the ellipsoid [m]; a NaN: 0.
    covariance : ndarray, shape (2, 2)
        East and north [m^2].

    Returns
    -------
    ring : ndarray, shape (65, 2)
        Longitude, -180 to 180, and latitude [deg]; the last point is the first.
    clipped : bool
        Whether part of it was more than a quarter of the way around the Earth off, and has been drawn there.
    """
    sigma, axes = axes_of(covariance)
    sigma = np.maximum(sigma, _SMALLEST)
    angle = 2 * np.pi * np.arange(_POINTS) / _POINTS
    if np.linalg.det(axes) < 0:
        angle = -angle
    way = (axes * sigma) @ np.stack([np.cos(angle), np.sin(angle)])
    w = 1 - WGS84_ECCENTRICITY_SQUARED * math.sin(math.radians(latitude)) ** 2
    prime, meridian = WGS84_AXIS / math.sqrt(w), WGS84_AXIS * (1 - WGS84_ECCENTRICITY_SQUARED) / w**1.5
    above = height if math.isfinite(height) else 0.0
    east, north, up = enu_rotation(math.radians(latitude), math.radians(longitude))
    turned = np.stack([way[0] / (prime + above), way[1] / (meridian + above)])
    size = np.linalg.norm(turned, axis=0)
    clipped = bool(np.any(size > _FARTHEST))
    towards = turned / np.where(size > 0, size, 1.0)
    size = np.minimum(size, _FARTHEST)[:, None]
    normal = np.cos(size) * up + np.sin(size) * (towards[0][:, None] * east + towards[1][:, None] * north)
    ring = np.degrees(
        np.stack([np.arctan2(normal[:, 1], normal[:, 0]), np.arcsin(np.clip(normal[:, 2], -1.0, 1.0))], axis=-1)
    )
    return np.concatenate([ring, ring[:1]]), clipped
