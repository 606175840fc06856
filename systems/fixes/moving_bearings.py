r"""Track of a target that moves straight on, from bearings of any number of stations and moving observers.

With :math:`p_i(x) = p + (t_i - t_e)\,v` and :math:`x = (p, v)` at the time t_e

.. math:: \hat x = \arg\min_x \sum_i \frac{w_i}{\sigma_i^2} [\theta_i - \mu_i(x)]^2, \qquad
          P = \Big(\sum_i \frac{w_i}{\sigma_i^2} g_i g_i^T\Big)^{-1}, \qquad
          g_i = \frac{1}{r_i}\begin{pmatrix} n_i \\ (t_i - t_e)\,n_i \end{pmatrix}

with the unit vector n across the line of sight: damped Gauss-Newton steps. It begins at the pseudo-linear solution,
:math:`n_i^T p_i(x) = n_i^T s_i` with measured directions at stations s (Lindgren and Gong, *Position and velocity
estimation via bearing observations*, IEEE Trans. Aerospace and Electronic Systems 14 (1978) 564-577), which is linear
and biased, and at the same of a target at rest. Where a single observer itself moves straight on there is no range in
the bearings (Nardone and Aidala, *Observability criteria for bearings-only target motion analysis*, ibid. 17 (1981)
162-166): the information is singular, and there is no
track.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angle_wrapping import wrap
from quietfix.systems.fixes.von_mises import DirectionFix

__all__ = ["moving_fix", "robust_moving_fix"]

Array = NDArray[np.float64]

_ITERATIONS = 100
_SETTLED = 1e-14  # relative: 1e-6 of a standard deviation where the cost is a hundred
_GAUSS_NEWTON = 1e-6  # a short step counts only if damping did not make it short
_FEW = 12  # iterations of subsets, of which only the best goes on
_RANK = 1e-9  # smallest eigenvalue of the information, scaled to unit diagonal: 3e-5 of a standard deviation
_ANDREWS = 1.5
_NOISE = 1e-6  # rad; the least spread of bearings that weights are made of


def _turned(place: Array, azimuth: Array, elapsed: Array, x: Array) -> tuple[Array, Array]:
    """Return residuals (k,) [rad] and gradients (k, 4) of the azimuths."""
    offset = x[:2] + elapsed[:, None] * x[2:] - place
    square = np.maximum(np.einsum("ki,ki->k", offset, offset), 1e-12)
    across = np.stack([-offset[:, 1], offset[:, 0]], axis=-1) / square[:, None]
    residual = wrap(azimuth - np.arctan2(offset[:, 1], offset[:, 0]))
    return residual, np.concatenate([across, elapsed[:, None] * across], axis=-1)


def _descend(
    place: Array, azimuth: Array, elapsed: Array, weight: Array, start: Array, iterations: int = _ITERATIONS
) -> tuple[Array, float]:
    """Return the minimum next to a start, and the sum of squares there."""
    x, damping = np.array(start), 1e-3
    residual, g = _turned(place, azimuth, elapsed, x)
    cost = float(weight @ residual**2)
    for _ in range(iterations):
        normal, slope = np.einsum("k,ki,kj->ij", weight, g, g), (weight * residual) @ g
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
        step = np.linalg.solve(normal / np.outer(scale, scale) + damping * np.eye(4), slope / scale) / scale
        after, turned = _turned(place, azimuth, elapsed, x + step)
        reached = float(weight @ after**2)
        if reached <= cost * (1 + 1e-15):
            settled = cost - reached <= _SETTLED * cost
            x, residual, g, cost, damping = x + step, after, turned, reached, max(damping / 10, 1e-12)
            if settled and damping <= _GAUSS_NEWTON:
                break
        else:
            damping *= 10
            if damping > 1e12:
                break
    return x, cost


def _starts(place: Array, azimuth: Array, elapsed: Array) -> list[Array]:
    """Return the pseudo-linear solution, and that of a target at rest."""
    across = np.stack([-np.sin(azimuth), np.cos(azimuth)], axis=-1)
    span = max(float(np.ptp(elapsed)), 1.0)
    rows = np.concatenate([across, elapsed[:, None] / span * across], axis=-1)
    middle = place.mean(axis=0)
    across_stations = np.einsum("ki,ki->k", across, place - middle)
    moving, resting = (np.linalg.lstsq(rows[:, :n], across_stations, rcond=None)[0] for n in (4, 2))
    return [np.append(middle + moving[:2], moving[2:] / span), np.append(middle + resting, [0.0, 0.0])]


def _track(
    place: Array, azimuth: Array, elapsed: Array, weight: Array, kappa: Array, starts: list[Array]
) -> DirectionFix:
    share = weight / np.median(weight[weight > 0])
    x, _ = min((_descend(place, azimuth, elapsed, share, one) for one in starts), key=lambda pair: pair[1])
    residual, g = _turned(place, azimuth, elapsed, x)
    information = np.einsum("k,ki,kj->ij", weight, g, g)
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    scaled = information / np.outer(scale, scale)
    nothing = np.full((4, 4), np.nan)
    covariance = np.linalg.inv(scaled) / np.outer(scale, scale) if np.linalg.eigvalsh(scaled)[0] > _RANK else nothing
    return DirectionFix(x, covariance, float(np.median(kappa)), weight / kappa, residual)


def moving_fix(time: Array, place: Array, azimuth: Array, sigma: Array) -> DirectionFix:
    """Return the most likely straight track, as position and velocity (4,) at the last time.

    Parameters
    ----------
    time : ndarray, shape (k,)
        [s]
    place : ndarray, shape (k, 2)
        Observers [m].
    azimuth, sigma : ndarray, shape (k,)
        Bearings counter-clockwise from x and their standard deviations [rad].

    Returns
    -------
    DirectionFix
        Of four states; the covariance is NaN where the bearings do not tell all of them.
    """
    elapsed, kappa = time - time[-1], sigma**-2.0
    return _track(place, azimuth, elapsed, kappa, kappa, _starts(place, azimuth, elapsed))


def robust_moving_fix(time: Array, place: Array, azimuth: Array, sigma: Array, iterations: int = 30) -> DirectionFix:
    """Return the same where a few wild bearings have no weight: Andrews' M-estimator, begun at the best of subsets.

    The subsets are those that leave out one stretch of the bearings in eight, and of each the track is tried by the
    median of the sizes of all residuals, as `quietfix.systems.fixes.von_mises.robust_fix` does with crossings.

    Parameters
    ----------
    time, place, azimuth, sigma
        See `moving_fix`.
    iterations : int
        Reweightings, at most.
    """
    elapsed, kappa, count = time - time[-1], sigma**-2.0, len(time)
    if count < 6:
        return moving_fix(time, place, azimuth, sigma)
    parts = [np.arange(count) % 8 != j for j in range(min(8, count - 4))]
    rng = np.random.default_rng(0)
    parts += [np.isin(np.arange(count), rng.choice(count, max(4, count // 2), replace=False)) for _ in range(12)]

    def size(x: Array) -> Array:
        return np.abs(_turned(place, azimuth, elapsed, x)[0]) / sigma

    tried = []
    for some in parts:
        for start in _starts(place[some], azimuth[some], elapsed[some]):
            x, _ = _descend(place[some], azimuth[some], elapsed[some], kappa[some] / kappa.max(), start, _FEW)
            tried.append((float(np.median(size(x))), x))
    best = min(tried, key=lambda pair: pair[0])[1]
    weights = np.ones(count)
    for _ in range(iterations):
        spread = max(1.4826 * (1 + 5 / max(count - 4, 1)) * float(np.median(size(best))), _NOISE)
        t = size(best) / spread / _ANDREWS
        renewed = np.where(t < np.pi, np.sinc(t / np.pi), 0.0)
        if np.count_nonzero(renewed > 0) < 5:
            break
        moved, _ = _descend(place, azimuth, elapsed, renewed * kappa / kappa.max(), best)
        settled = np.abs(renewed - weights).max() < 1e-9
        weights, best = renewed, moved
        if settled:
            break
    return _track(place, azimuth, elapsed, weights * kappa, kappa, [best])
