r"""The curve in space that two delays leave, followed point by point.

Two TDOAs fix a position up to a curve: nearly a line of sight where the satellites span a plane, nearly a circle
around the orbit where they fly in one. A height cuts the circle twice, left and right of the track, or not at all
where the circle passes over it. So no coordinate serves as parameter everywhere, and the curve is followed by its
arc length: along the tangent :math:`t = g_1 \times g_2` (g: gradients of the delays), and back onto the curve by the
shortest Newton step :math:`G^T (G G^T)^{-1} r`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import ecef_to_geodetic, up
from quietfix.systems.linear_algebra import solve
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["delay_curve"]

Array = NDArray[np.float64]

_BEARINGS, _RINGS = 24, 16  # of the grid on the ground where the curve is looked for
_HORIZON = 0.98  # share of the way to the horizon that the grid covers
_REACH = 4.0  # sigmas of height; 6e-5 of the cases lie outside
_LARGEST_STEP = 300e3  # m
_ITERATIONS = 30
_ON_CURVE = 1.0  # m of both range differences; a hundredth of what a good TDOA says
_CORRECTIONS = 2
_FEWEST_STEPS_IN_WINDOW = 16
_MOST_STEPS = 2000


def delay_curve(
    delays: MeasurementModel,
    measured: Array,
    platforms: Array,
    height: Array,
    sigma_height: float,
    watched: MeasurementModel,
    spacing: float,
) -> Array:
    """Return points on the curve of two measured delays, at heights that are possible.

    Possible is what lies within 4 sigmas of an assumed height; sigma counts both its own error and that of the
    delays, which lift and lower the curve.

    Parameters
    ----------
    delays : MeasurementModel
        Two rows in seconds, the second and third platform against the first, or alike.
    measured : ndarray, shape (trials, 2)
        The delays [s].
    platforms : ndarray, shape (1 or trials, p, 6)
        Platforms of `delays` and `watched`, Earth-fixed.
    height : ndarray, shape (trials,)
        Assumed height above the WGS-84 ellipsoid [m].
    sigma_height : float
        Its standard deviation [m].
    watched : MeasurementModel
        Its rows move by at most about `spacing` from one point to the next.
    spacing : float
        In the unit of `watched`.

    Returns
    -------
    ndarray, shape (trials, points, 3)
        Earth-fixed positions [m] in no particular order, NaN where a trial has fewer points than another. All are
        NaN in a trial whose curve does not enter the window in sight of all platforms.
    """
    foot = _land(delays, measured, platforms, _nearest(delays, measured, platforms))
    position = np.stack([foot, foot])
    with np.errstate(invalid="ignore", divide="ignore"):
        margin = _REACH * np.hypot(sigma_height, _lift(delays, foot, platforms))
        low, high = height - margin, height + margin
        tangent = _tangent(delays, position, platforms)
        tangent[1] *= -1
        found = []
        walking = np.isfinite(position).all(axis=-1)
        for _ in range(_MOST_STEPS):
            level, normal = ecef_to_geodetic(position)[2], up(position)
            rising = np.einsum("...i,...i->...", tangent, normal)
            walking &= _in_sight(position, normal, platforms) & ~((level > high) & (rising > 0))
            if not walking.any():
                break
            inside = walking & (level >= low) & (level <= high)
            found.append(np.where(inside[..., None], position, np.nan))
            step = _step(position, tangent, level, rising, platforms, low, high, watched, spacing)
            position = np.where(walking[..., None], position + step[..., None] * tangent, position)
            for _ in range(_CORRECTIONS):
                position = position + _back(delays, measured, position, platforms)[0]
            ahead = _tangent(delays, position, platforms)
            same = np.einsum("...i,...i->...", ahead, tangent) >= 0
            tangent = np.where(same[..., None], ahead, -ahead)
            walking &= np.isfinite(position).all(axis=-1) & np.isfinite(tangent).all(axis=-1)
    if not found:
        return np.full((measured.shape[0], 1, 3), np.nan)
    points = np.concatenate(found)  # the foot is there twice, which does no harm
    points = points[np.any(np.isfinite(points), axis=(-1, -2))]
    return np.moveaxis(points, 0, 1) if points.size else np.full((measured.shape[0], 1, 3), np.nan)


def _at_rest(position: Array) -> Array:
    return np.concatenate([position, np.zeros_like(position)], axis=-1)


def _back(delays: MeasurementModel, measured: Array, position: Array, platforms: Array) -> tuple[Array, Array]:
    """Return the shortest step to the curve, and how far off the range differences are [m]."""
    value, jacobian = delays.linearize(_at_rest(position), platforms)
    g = SPEED_OF_LIGHT * jacobian[..., :3]
    r = SPEED_OF_LIGHT * (measured - value)
    gram = np.einsum("...ik,...jk->...ij", g, g)
    a, b, c = gram[..., 0, 0], gram[..., 0, 1], gram[..., 1, 1]
    determinant = a * c - b**2
    # Written out: a singular trial then gives inf or NaN of its own and no exception for all.
    first = (c * r[..., 0] - b * r[..., 1]) / determinant
    second = (a * r[..., 1] - b * r[..., 0]) / determinant
    return first[..., None] * g[..., 0, :] + second[..., None] * g[..., 1, :], np.abs(r).max(axis=-1)


def _tangent(delays: MeasurementModel, position: Array, platforms: Array) -> Array:
    g = delays.jacobian(_at_rest(position), platforms)[..., :3]
    t = np.cross(g[..., 0, :], g[..., 1, :])
    return t / np.linalg.norm(t, axis=-1, keepdims=True)


def _lift(delays: MeasurementModel, position: Array, platforms: Array) -> Array:
    r"""Return by how much the delays' errors move the curve up or down [m]: of :math:`G^+ R\,G^{+T}` the vertical."""
    g = delays.jacobian(_at_rest(position), platforms)[..., :3] / delays.sigmas[:, None]
    level = np.einsum("...ik,...k->...i", g, up(position))
    correlation = delays.noise_covariance() / np.outer(delays.sigmas, delays.sigmas)
    gram = np.einsum("...ik,...jk->...ij", g, g)
    finite = np.all(np.isfinite(gram), axis=(-1, -2))
    weights = solve(np.where(finite[..., None, None], gram, np.eye(2)), level[..., None])[..., 0]
    return np.sqrt(np.einsum("...i,ij,...j->...", weights, correlation, weights))


def _in_sight(position: Array, normal: Array, platforms: Array) -> NDArray[np.bool_]:
    offset = platforms[..., :3] - position[..., None, :]
    return (np.einsum("...pi,...i->...p", offset, normal) > 0).all(axis=-1)


def _nearest(delays: MeasurementModel, measured: Array, platforms: Array) -> Array:
    """Return the point of a grid on the ground whose delays come closest, shape (trials, 3)."""
    satellite = platforms[:, 0, :3]
    distance = np.linalg.norm(satellite, axis=-1)
    radius = distance - ecef_to_geodetic(satellite)[2]
    zenith = satellite / distance[:, None]
    side = np.cross(zenith, np.where(np.abs(zenith[:, 2:]) < 0.7, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    front = np.cross(zenith, side)
    bearing = np.arange(_BEARINGS) * (2 * np.pi / _BEARINGS)
    level = np.cos(bearing)[:, None, None] * side + np.sin(bearing)[:, None, None] * front
    arc = (np.arange(_RINGS) + 0.5)[:, None] / _RINGS * _HORIZON * np.arccos(radius / distance)
    grid = np.cos(arc)[:, None, :, None] * zenith + np.sin(arc)[:, None, :, None] * level
    grid = (radius[:, None] * grid).reshape(-1, *satellite.shape)
    misfit = (np.abs(delays.predict(_at_rest(grid), platforms) - measured) ** 2).sum(axis=-1)
    best = np.argmin(np.where(np.isfinite(misfit), misfit, np.inf), axis=0)
    chosen = np.broadcast_to(grid, (grid.shape[0], measured.shape[0], 3))[best, np.arange(measured.shape[0])]
    return np.where(np.all(np.isfinite(measured), axis=-1, keepdims=True), chosen, np.nan)


def _land(delays: MeasurementModel, measured: Array, platforms: Array, start: Array) -> Array:
    """Return the points of the curves near `start`; NaN where Newton's method does not get there."""
    position, off = start, np.full(start.shape[0], np.inf)
    with np.errstate(invalid="ignore", divide="ignore"):
        for _ in range(_ITERATIONS):
            step, off = _back(delays, measured, position, platforms)
            moving = off > _ON_CURVE
            if not moving.any():
                break
            size = np.linalg.norm(step, axis=-1, keepdims=True)
            step = step * np.minimum(1.0, _LARGEST_STEP / size)
            position = np.where(moving[:, None], position + step, position)
        return np.where((off <= _ON_CURVE)[:, None], position, np.nan)


def _step(
    position: Array,
    tangent: Array,
    level: Array,
    rising: Array,
    platforms: Array,
    low: Array,
    high: Array,
    watched: MeasurementModel,
    spacing: float,
) -> Array:
    r"""Return how far to go [m].

    The height may change by a share of the window, or of the way to it: with a curve no tighter than the range r,
    a step s changes it by at most :math:`|t\cdot n|\,s + s^2/2r`. Near the window the watched rows count too.
    """
    reach = np.linalg.norm(platforms[..., 0, :3] - position, axis=-1)
    fine = (high - low) / _FEWEST_STEPS_IN_WINDOW
    outside = np.maximum(np.maximum(low - level, level - high), 0.0)
    slope = np.abs(rising)
    change = np.maximum(fine, 0.5 * outside)
    step = np.minimum(reach * (np.sqrt(slope**2 + 2 * change / reach) - slope), 0.1 * reach)
    speed = np.einsum("...mi,...i->...m", watched.jacobian(_at_rest(position), platforms)[..., :3], tangent)
    calm = spacing / np.maximum(np.abs(speed).max(axis=-1), np.finfo(float).tiny)
    return np.where(outside <= 2 * fine, np.minimum(step, calm), step)
