r"""Position from one measurement alone: weighted least squares from several starts.

.. math:: \hat p = \arg\min_p\ [z - h(p)]^T R^{-1} [z - h(p)]\ (+\ [p - \bar p]^T P^{-1} [p - \bar p])

by Levenberg's and Marquardt's damped Gauss-Newton iteration (Marquardt, *An algorithm for least-squares estimation of
nonlinear parameters*, J. SIAM 11 (1963) 431-441). Arrival times enter as differences against one receiver with the
correlated R of `differenced_covariance`: that weighting eliminates the unknown time of emission exactly, whichever
receiver is the reference.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from systems.filters.linear_algebra import cholesky, symmetric
from systems.filters.whitening import Whitener
from systems.frames import ecef_to_geodetic, enu_rotation, geodetic_to_ecef
from systems.measurement.base import MeasurementModel

__all__ = ["SnapshotFix", "starts_around", "snapshot_fix"]

Array = NDArray[np.float64]

_ITERATIONS = 60
_CONVERGED = 1e-8  # predicted decrease of the cost: a step of 1e-4 standard deviations
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-12, 1e12
_GAUSS_NEWTON = 1e-2  # a short step counts as convergence only if damping did not make it short
_RANK = 1e-12  # smallest eigenvalue of the information, scaled to unit diagonal


class SnapshotFix(NamedTuple):
    """A fix, over leading axes.

    Attributes
    ----------
    position : ndarray, shape (..., 3)
        Earth-fixed [m]; NaN where no start converged, or the rows do not determine a position.
    covariance : ndarray, shape (..., 3, 3)
        Inverse of the information at the fix.
    cost : ndarray, shape (...)
        The minimum; chi-square with `dof` degrees of freedom if model and noise are right.
    dof : ndarray, shape (...)
        Rows used, and 3 for a prior, minus 3.
    """

    position: Array
    covariance: Array
    cost: Array
    dof: Array


def starts_around(platforms: Array, height: Array, directions: int = 6) -> Array:
    """Return places to start from: above the middle of the platforms, and on a circle around it.

    The circle's radius is the distance of the outermost platform from the middle.

    Parameters
    ----------
    platforms : ndarray, shape (..., p, >= 3)
        Earth-fixed positions first [m]; NaN where one is missing.
    height : ndarray, shape (...)
        Height of the starts above the WGS-84 ellipsoid [m].
    directions : int
        Places on the circle.

    Returns
    -------
    ndarray, shape (..., 1 + directions, 3)
        Earth-fixed [m]; NaN where no platform is known.
    """
    position = platforms[..., :3]
    known = np.isfinite(position).all(axis=-1)
    count = np.count_nonzero(known, axis=-1)
    present = np.where(known[..., None], position, 0.0)
    middle = present.sum(axis=-2) / np.where(count > 0, count, np.nan)[..., None]
    reach = np.where(known, np.linalg.norm(present - middle[..., None, :], axis=-1), 0.0).max(axis=-1)
    latitude, longitude, _ = ecef_to_geodetic(middle)
    height = np.broadcast_to(height, latitude.shape)
    above = geodetic_to_ecef(latitude, longitude, height)

    azimuth = 2 * np.pi * np.arange(directions) / directions
    ring = np.stack([np.sin(azimuth), np.cos(azimuth), np.zeros(directions)], axis=-1)
    offset = np.einsum("...ji,dj->...di", enu_rotation(latitude, longitude), ring) * reach[..., None, None]
    around = ecef_to_geodetic(above[..., None, :] + offset)
    lifted = geodetic_to_ecef(around[0], around[1], height[..., None])
    return np.concatenate([above[..., None, :], lifted], axis=-2)


def snapshot_fix(
    measurement: Array,
    platforms: Array,
    model: MeasurementModel,
    noise: Array,
    starts: Array,
    prior: tuple[Array, Array] | None = None,
) -> SnapshotFix:
    """Return the weighted least-squares fix: of all starts, the lowest minimum.

    Parameters
    ----------
    measurement : ndarray, shape (..., m)
        NaN where a row is missing.
    platforms : ndarray, shape (..., p, 6)
        Known carriers; NaN where one is missing, and with it the rows that need it. Broadcasts.
    model : MeasurementModel
        It must not depend on the velocity, which is taken as zero.
    noise : ndarray, shape (m, m) or (..., m, m)
        R.
    starts : ndarray, shape (..., s, 3)
        Where to start [m].
    prior : (ndarray (..., 3), ndarray (..., 3, 3)), optional
        Mean and covariance of what is known already; NaN where nothing is.

    Returns
    -------
    SnapshotFix
    """
    lead = np.broadcast_shapes(measurement.shape[:-1], platforms.shape[:-2], noise.shape[:-2], starts.shape[:-2])
    count, m = starts.shape[-2], model.size
    whole = (*lead, count)

    def spread(array: Array, trailing: int) -> Array:
        """Give every start its own copy of what belongs to a fix, with one leading axis."""
        tail = array.shape[array.ndim - trailing :]
        wide = np.broadcast_to(array, (*lead, *tail))[..., None, :].reshape(*lead, 1, *tail) if tail else array
        return np.broadcast_to(wide, (*whole, *tail)).reshape(-1, *tail)

    raise NotImplementedError
