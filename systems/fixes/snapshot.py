r"""Position from one measurement alone: weighted least squares from several starts.

.. math:: \hat p = \arg\min_p\ [z - h(p)]^T R^{-1} [z - h(p)]\ (+\ [p - \bar p]^T P^{-1} [p - \bar p])

by Levenberg's and Marquardt's damped Gauss-Newton iteration (Marquardt, *An algorithm for least-squares estimation of
nonlinear parameters*, J. SIAM 11 (1963) 431-441). Arrival times enter as differences against one receiver with the
correlated R of `differenced_covariance`: that weighting eliminates the unknown time of emission exactly, whichever
receiver is the reference.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.earth.geodetic import ecef_to_geodetic, enu_rotation, geodetic_to_ecef
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.linear_algebra import cholesky, inverses, solve, symmetric
from quietfix.systems.measurement.base import MeasurementModel

__all__ = [
    "SnapshotFix",
    "snapshot_fix",
    "starts_around",
    "starts_around_level",
    "starts_on_ground",
    "under_ground",
    "under_ground_level",
]

Array = NDArray[np.float64]

_ITERATIONS = 25  # a start that is not there by then is lost; half of them need four
_CONVERGED = 1e-8  # predicted decrease of the cost: a step of 1e-4 standard deviations
_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 0.1, 1e-12, 1e12
_GAUSS_NEWTON = 1e-2  # a short step counts as convergence only if damping did not make it short
_RANK = 1e-12  # smallest eigenvalue of the information, scaled to unit diagonal
_DEEP = 500.0  # m: no land lies lower, and no geoid is so far below the ellipsoid


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
    middle, reach = _middle(platforms)
    latitude, longitude, reach, height = np.broadcast_arrays(*ecef_to_geodetic(middle)[:2], reach, height)
    above = geodetic_to_ecef(latitude, longitude, height)

    offset = np.einsum("...ji,dj->...di", enu_rotation(latitude, longitude), _ring(directions)) * reach[..., None, None]
    around = ecef_to_geodetic(above[..., None, :] + offset)
    lifted = geodetic_to_ecef(around[0], around[1], height[..., None])
    return np.concatenate([above[..., None, :], lifted], axis=-2)


def starts_on_ground(platforms: Array, height: Array) -> Array:
    """Return the places of `starts_around`, and those on a circle three times as wide: of a target far outside."""
    middle, _ = _middle(platforms)
    wide = middle[..., None, :] + 3 * (platforms[..., :3] - middle[..., None, :])
    return np.concatenate([starts_around(platforms, height), starts_around(wide, height)[..., 1:, :]], axis=-2)


def starts_around_level(platforms: Array, height: Array, directions: int = 6) -> Array:
    """Return the same places as `starts_around` in local axes: east, north, up on a flat Earth."""
    middle, reach = _middle(platforms)
    reach, height = np.broadcast_arrays(reach, height)
    above = np.concatenate([np.broadcast_to(middle, (*height.shape, 3))[..., :2], height[..., None]], axis=-1)
    around = above[..., None, :] + reach[..., None, None] * _ring(directions)
    return np.concatenate([above[..., None, :], around], axis=-2)


def under_ground(position: Array, platforms: Array) -> NDArray[np.bool_]:
    """Return where Earth-fixed places (..., s, 3) lie 500 m below the ellipsoid and below all platforms (..., p, >= 3).

    Receivers that stand about in a plane hear a target above it and its image below almost alike: noise alone then
    decides which of the two costs less.
    """
    return _deeper(ecef_to_geodetic(position)[2], ecef_to_geodetic(platforms[..., :3])[2])


def under_ground_level(position: Array, platforms: Array) -> NDArray[np.bool_]:
    """Return the same as `under_ground` in local axes: east, north, up on a flat Earth."""
    return _deeper(position[..., 2], platforms[..., 2])


def _deeper(height: Array, platforms: Array) -> NDArray[np.bool_]:
    lowest = np.where(np.isfinite(platforms), platforms, 0.0).min(axis=-1, keepdims=True, initial=0.0)
    with np.errstate(invalid="ignore"):
        return np.asarray(height < lowest - _DEEP)


def _middle(platforms: Array) -> tuple[Array, Array]:
    """Return the middle (..., 3) of the platforms that are known and the distance of the outermost one (...)."""
    position = platforms[..., :3]
    known = np.all(np.isfinite(position), axis=-1)
    count = np.count_nonzero(known, axis=-1)
    present = np.where(known[..., None], position, 0.0)
    middle = present.sum(axis=-2) / np.where(count > 0, count, np.nan)[..., None]
    return middle, np.where(known, np.linalg.norm(present - middle[..., None, :], axis=-1), 0.0).max(axis=-1)


def _ring(directions: int) -> Array:
    """Return unit vectors to the east, north and up around a circle, shape (directions, 3)."""
    azimuth = 2 * np.pi * np.arange(directions) / directions
    return np.stack([np.sin(azimuth), np.cos(azimuth), np.zeros(directions)], axis=-1)


def snapshot_fix(
    measurement: Array,
    platforms: Array,
    model: MeasurementModel,
    noise: Array,
    starts: Array,
    prior: tuple[Array, Array] | None = None,
    as_well: float = 0.0,
    buried: Callable[[Array, Array], NDArray[np.bool_]] | None = None,
) -> SnapshotFix:
    """Return the weighted least-squares fix: of all starts, the lowest minimum.

    Parameters
    ----------
    measurement : ndarray, shape (..., m)
        NaN where a row is missing.
    platforms : ndarray, shape (..., p, 6)
        Known platforms; NaN where one is missing, and with it the rows that need it. Broadcasts.
    model : MeasurementModel
        It must not depend on the velocity, which is taken as zero.
    noise : ndarray, shape (m, m) or (..., m, m)
        R.
    starts : ndarray, shape (..., s, 3)
        Where to start [m].
    prior : (ndarray (..., 3), ndarray (..., 3, 3)), optional
        Mean and covariance of what is known already; NaN where nothing is.
    as_well : float
        How much more a minimum may cost and still count as the lowest: of such the one nearest to the first start is
        taken. Curves may meet in several places, at costs that differ by rounding alone.
    buried : callable, optional
        ``(position (f, s, 3), platforms (f, p, 6)) -> (f, s)``: minima that count only where there is no other, such as
        `under_ground`.

    Returns
    -------
    SnapshotFix
    """
    lead = np.broadcast_shapes(measurement.shape[:-1], platforms.shape[:-2], noise.shape[:-2], starts.shape[:-2])

    def flat(array: Array, trailing: int) -> Array:
        tail = array.shape[array.ndim - trailing :]
        return np.broadcast_to(array, (*lead, *tail)).reshape(-1, *tail)

    places = flat(starts, 2)
    fixes, count = places.shape[:2]
    problem = _Problem(
        flat(measurement, 1),
        flat(platforms, 2),
        model,
        flat(noise, 2),
        None if prior is None else (flat(prior[0], 1), flat(prior[1], 2)),
    )
    position, information, cost = _levenberg(problem, places.reshape(-1, 3), np.repeat(np.arange(fixes), count))

    cost = cost.reshape(fixes, count)
    if buried is not None:
        above = np.isfinite(cost) & ~buried(position.reshape(fixes, count, 3), flat(platforms, 2))
        cost = np.where(above | ~above.any(axis=-1, keepdims=True), cost, np.nan)
    best = np.argmin(np.where(np.isfinite(cost), cost, np.inf), axis=-1)
    if as_well:
        away = np.linalg.norm(position.reshape(fixes, count, 3) - places[:, :1], axis=-1)
        low = cost <= cost[np.arange(fixes), best, None] + as_well
        best = np.argmin(np.where(low, away, np.inf), axis=-1)
    chosen = np.arange(fixes) * count + best
    found = np.isfinite(cost[np.arange(fixes), best])
    covariance = np.full((fixes, 3, 3), np.nan)
    covariance[found] = symmetric(inverses(information[chosen[found]]))
    return SnapshotFix(
        np.where(found[:, None], position[chosen], np.nan).reshape(*lead, 3),
        covariance.reshape(*lead, 3, 3),
        np.where(found, cost[np.arange(fixes), best], np.nan).reshape(lead),
        (problem.rows - 3.0).reshape(lead),
    )


class _Problem:
    """Fixes to be made, each with its data: leading axis (fixes,)."""

    def __init__(
        self,
        measurement: Array,
        platforms: Array,
        model: MeasurementModel,
        noise: Array,
        prior: tuple[Array, Array] | None,
    ) -> None:
        self._model = model
        self._measurement = measurement
        self._platforms = platforms
        far_out = np.zeros((1, 6))
        far_out[0, 2] = 7e6  # any place where the models are defined: which rows exist does not depend on it
        with np.errstate(invalid="ignore"):
            exists = np.isfinite(model.predict(far_out, platforms)) & np.isfinite(measurement)
        self._missing = ~exists
        self._whitening = Whitener(noise).matrix(self._missing)
        self.rows = np.count_nonzero(exists, axis=-1).astype(float)
        self._prior = None
        if prior is not None:
            mean, covariance = prior
            known = np.all(np.isfinite(mean), axis=-1) & np.all(np.isfinite(covariance), axis=(-1, -2))
            root = inverses(cholesky(np.where(known[:, None, None], covariance, np.eye(3))))
            self._prior = np.where(known[:, None], mean, 0.0), np.where(known[:, None, None], root, 0.0)
            self.rows += 3.0 * known

    def linearize(self, which: NDArray[np.intp], position: Array) -> tuple[Array, Array]:
        """Return whitened residuals and their negative derivative, (n, rows) and (n, rows, 3), at (n, 3)."""
        target = np.concatenate([position, np.zeros_like(position)], axis=-1)
        value, jacobian = self._model.linearize(target, self._platforms[which])
        missing = self._missing[which]
        residual = np.where(missing, 0.0, self._model.residual(self._measurement[which], value))
        gradient = np.where(missing[..., None], 0.0, jacobian[..., :3])
        w = self._whitening[which]
        residual, gradient = np.einsum("nij,nj->ni", w, residual), w @ gradient
        if self._prior is not None:
            mean, root = (part[which] for part in self._prior)
            extra = np.einsum("nij,nj->ni", root, mean - position)
            residual, gradient = np.concatenate([residual, extra], axis=1), np.concatenate([gradient, root], axis=1)
        return residual, gradient


def _levenberg(problem: _Problem, position: Array, owner: NDArray[np.intp]) -> tuple[Array, Array, Array]:
    """Return minima, their information and cost; cost NaN where there is none. Each start stops by itself."""
    position = position.copy()
    information = np.full((position.shape[0], 3, 3), np.nan)
    cost = np.full(position.shape[0], np.nan)
    active = np.flatnonzero(np.isfinite(position).all(axis=-1) & (problem.rows[owner] >= 3))
    here = position[active]
    residual, gradient = problem.linearize(owner[active], here)
    value = np.einsum("ni,ni->n", residual, residual)
    damping = np.full(active.size, _FIRST_DAMPING)
    for _ in range(_ITERATIONS):
        if active.size == 0:
            break
        normal = np.swapaxes(gradient, -1, -2) @ gradient
        slope = np.einsum("nmi,nm->ni", gradient, residual)
        scale = np.sqrt(np.einsum("nii->ni", normal))
        solvable = (scale > 0).all(axis=-1) & np.isfinite(value)
        scale = np.where(solvable[:, None], scale, 1.0)
        scaled = np.where(solvable[:, None, None], normal / (scale[:, :, None] * scale[:, None, :]), np.eye(3))
        step = solve(scaled + damping[:, None, None] * np.eye(3), (slope / scale)[..., None])[..., 0] / scale
        decrease = np.einsum("ni,ni->n", step, slope)

        arrived = solvable & (decrease <= _CONVERGED) & (damping <= _GAUSS_NEWTON)
        if arrived.any():
            determined = np.linalg.eigvalsh(scaled)[:, 0] > _RANK
            good = arrived & determined
            position[active[good]], information[active[good]], cost[active[good]] = (
                here[good],
                normal[good],
                value[good],
            )
        going = solvable & ~arrived & (damping < _MOST_DAMPING)
        active, here, residual, gradient, value, damping, step = (
            array[going] for array in (active, here, residual, gradient, value, damping, step)
        )
        moved = here + step
        new_residual, new_gradient = problem.linearize(owner[active], moved)
        new_value = np.einsum("ni,ni->n", new_residual, new_residual)
        # the slack lets a step through that rounding alone makes worse
        better = new_value <= value * (1 + 1e-12) + 1e-12
        here = np.where(better[:, None], moved, here)
        residual = np.where(better[:, None], new_residual, residual)
        gradient = np.where(better[:, None, None], new_gradient, gradient)
        value = np.where(better, new_value, value)
        damping = np.where(better, np.maximum(damping / 10, _LEAST_DAMPING), damping * 10)
    return position, information, cost
