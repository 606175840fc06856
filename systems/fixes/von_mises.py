r"""Position from a few bearings of unknown quality: von Mises errors with one unknown concentration.

Lenth, *On finding the source of a signal*, Technometrics 23 (1981) 149-154. With azimuths :math:`\theta_i` and those of
the position, :math:`\mu_i(x)`,

.. math:: \hat x = \arg\max_x \sum_i w_i\cos(\theta_i - \mu_i(x)), \qquad
          A(\hat\kappa) = \frac{I_1(\hat\kappa)}{I_0(\hat\kappa)} = \overline{\cos(\theta_i - \mu_i)}

maximises the likelihood whatever the concentration. The covariance is the inverse of the expected information
:math:`\kappa A(\kappa)\sum_i g_i g_i^T`, :math:`g_i = [-\sin\mu_i, \cos\mu_i]/r_i`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import ive

from quietfix.systems.angle_wrapping import wrap

__all__ = ["DirectionFix", "concentration", "robust_fix", "sample", "von_mises_fix", "weighted_fix"]

Array = NDArray[np.float64]

_ITERATIONS = 200
_STARTS = 200  # crossings that are tried; of more, evenly spread ones
_MOST = 1000  # bearings among which starts are compared; of more, a sample
_BEST = 3  # of the starts go on with all bearings
_ANDREWS = 1.5  # bearings whose residual exceeds pi times so many standard deviations have no weight


class DirectionFix(NamedTuple):
    """A fix.

    Attributes
    ----------
    position : ndarray, shape (2,)
        NaN where there is none.
    covariance : ndarray, shape (2, 2)
    concentration : float
        kappa; the standard deviation of a bearing is nearly its inverse square root [rad].
    weights : ndarray, shape (k,)
        0 for a bearing that was set aside.
    residuals : ndarray, shape (k,)
        Measured minus expected azimuth [rad].
    """

    position: Array
    covariance: Array
    concentration: float
    weights: Array
    residuals: Array


def concentration(mean_cosine: float) -> float:
    """Return kappa with I1(kappa)/I0(kappa) = mean_cosine; 0 for no concentration at all."""
    if not mean_cosine > 1e-6:
        return 0.0

    def excess(kappa: float) -> float:
        return float(ive(1, kappa) / ive(0, kappa)) - mean_cosine

    most = 1e9
    return most if excess(most) < 0 else float(brentq(excess, 1e-9, most, rtol=1e-12))


def _ascend(place: Array, azimuth: Array, weights: Array, start: Array) -> tuple[Array, float]:
    """Return the maximum next to a start, by damped Gauss-Newton steps, and the sum of cosines there."""

    def value(x: Array) -> float:
        offset = x - place
        return float(weights @ np.cos(azimuth - np.arctan2(offset[:, 1], offset[:, 0])))

    x, best, damping = np.array(start), value(start), 1e-3
    for _ in range(_ITERATIONS):
        offset = x - place
        square = np.einsum("ki,ki->k", offset, offset)
        if not square.min() > 0:
            break
        g = np.stack([-offset[:, 1], offset[:, 0]], axis=-1) / square[:, None]
        turned = azimuth - np.arctan2(offset[:, 1], offset[:, 0])
        gradient = (weights * np.sin(turned)) @ g
        # Expected curvature: positive everywhere, which that of the cosines is not.
        curvature = np.einsum("k,ki,kj->ij", weights, g, g)
        step = np.linalg.solve(curvature + damping * np.diag(np.diag(curvature)) + 1e-300 * np.eye(2), gradient)
        reached = value(x + step)
        if reached >= best:
            x, best, damping = x + step, reached, max(damping / 10, 1e-12)
            if np.linalg.norm(step) < 1e-12 * np.sqrt(square.max()):
                break
        else:
            damping *= 10
            if damping > 1e12:
                break
    return x, best


def _starts(place: Array, azimuth: Array) -> Array:
    """Return all crossings of two lines, ahead of both, and the middle of the platforms."""
    k = len(azimuth)
    few = np.unique(np.linspace(0, k - 1, min(k, 60)).astype(int))
    i, j = few[np.array(np.triu_indices(len(few), 1))]
    sine = np.sin(azimuth[j] - azimuth[i])
    usable = np.abs(sine) > 1e-3
    i, j, sine = i[usable], j[usable], sine[usable]
    some = np.unique(np.linspace(0, len(i) - 1, min(len(i), _STARTS)).astype(int)) if len(i) else slice(None)
    i, j, sine = i[some], j[some], sine[some]
    base = place[j] - place[i]
    reach = (base[:, 0] * np.sin(azimuth[j]) - base[:, 1] * np.cos(azimuth[j])) / sine
    crossings = place[i] + reach[:, None] * np.stack([np.cos(azimuth[i]), np.sin(azimuth[i])], axis=-1)
    return np.concatenate([crossings, place.mean(axis=0)[None] + 1e-3 * np.ptp(place, axis=0).max()])


def _highest(place: Array, azimuth: Array, weights: Array, starts: Array) -> Array:
    """Return the highest maximum that is reached from the starts."""
    if len(azimuth) > _MOST and len(starts) > 1:
        some = sample(len(azimuth), _MOST)
        tried = sorted((_ascend(place[some], azimuth[some], weights[some], x) for x in starts), key=lambda p: -p[1])
        starts = np.array([x for x, _ in tried[:_BEST]])
    tried = [_ascend(place, azimuth, weights, start) for start in starts]
    return max(tried, key=lambda pair: pair[1])[0]


def _fix(place: Array, azimuth: Array, weights: Array, starts: Array) -> DirectionFix:
    position = _highest(place, azimuth, weights, starts)
    offset = position - place
    residuals = wrap(azimuth - np.arctan2(offset[:, 1], offset[:, 0]))
    kappa = concentration(float(weights @ np.cos(residuals) / weights.sum()))
    square = np.einsum("ki,ki->k", offset, offset)
    g = np.stack([-offset[:, 1], offset[:, 0]], axis=-1) / square[:, None]
    information = kappa * float(ive(1, kappa) / ive(0, kappa)) * np.einsum("k,ki,kj->ij", weights, g, g)
    try:
        covariance = np.linalg.inv(information)
    except np.linalg.LinAlgError:
        covariance = np.full((2, 2), np.nan)
    return DirectionFix(position, covariance, kappa, weights, residuals)


def von_mises_fix(place: Array, azimuth: Array) -> DirectionFix:
    """Return the maximum-likelihood fix with one unknown concentration.

    Parameters
    ----------
    place : ndarray, shape (k, 2)
        Platforms, in any unit of length.
    azimuth : ndarray, shape (k,)
        [rad]

    Returns
    -------
    DirectionFix
    """
    return _fix(place, azimuth, np.ones(len(azimuth)), _starts(place, azimuth))


def weighted_fix(place: Array, azimuth: Array, kappa: Array, near: Sequence[Array] = ()) -> Array:
    """Return the maximum-likelihood position (2,) where the concentration of each bearing is known.

    Parameters
    ----------
    place, azimuth
        See `von_mises_fix`.
    kappa : ndarray, shape (k,)
    near : sequence of ndarray, shape (2,)
        Places from which the search begins, besides the best of the crossings.
    """
    starts = _starts(place, azimuth)
    some = sample(len(azimuth), _MOST)
    offset = starts[:, None] - place[some]
    value = np.cos(azimuth[some] - np.arctan2(offset[..., 1], offset[..., 0])) @ kappa[some]
    also = np.reshape([x for x in near if np.isfinite(x).all()], (-1, 2))
    return _highest(place, azimuth, kappa / kappa.max(), np.concatenate([starts[np.argsort(-value)[:_BEST]], also]))


def sample(count: int, most: int) -> NDArray[np.intp]:
    """Return so many of `count` rows, in order: one of each of `most` equal stretches, drawn at random.

    At random, because rows of several observers in turn beat with a fixed step; always the same, for repetition.
    """
    if count <= most:
        return np.arange(count)
    edges = np.linspace(0, count, most + 1)
    where = np.random.default_rng(0).random(most)
    return np.minimum((edges[:-1] + where * np.diff(edges)).astype(np.intp), count - 1)


def _least_median(place: Array, azimuth: Array, starts: Array) -> Array:
    some = sample(len(azimuth), _MOST)
    offset = starts[:, None] - place[some]
    size = np.abs(wrap(azimuth[some] - np.arctan2(offset[..., 1], offset[..., 0])))
    return starts[np.argmin(np.median(size, axis=-1))]


def robust_fix(place: Array, azimuth: Array, iterations: int = 50) -> DirectionFix:
    r"""Return a fix that a few wild bearings do not move: Andrews' M-estimator, as Lenth has it.

    .. math:: t_i = \sqrt{2\kappa(1 - \cos(\theta_i - \mu_i))}, \qquad
              w_i = \frac{\sin(t_i/c)}{t_i/c}\ \text{for}\ t_i < c\pi,\ \text{else}\ 0

    :math:`\kappa` follows from the median of the sizes of the residuals, which half of the bearings cannot spoil. It
    starts at the crossing of two lines that has the least such median (Rousseeuw, J. American Statistical Association
    79 (1984) 871-880).

    Parameters
    ----------
    place, azimuth
        See `von_mises_fix`.
    iterations : int
        Reweightings, at most.
    """
    starts = _starts(place, azimuth)
    count = len(azimuth)

    def sizes(x: Array) -> Array:
        offset = x - place
        return np.abs(wrap(azimuth - np.arctan2(offset[:, 1], offset[:, 0])))

    best = _least_median(place, azimuth, starts)
    weights = np.ones(count)
    # Of a normal distribution, and enlarged for few bearings (Rousseeuw and Leroy, Robust Regression, 1987, ch. 5).
    scale = 1.4826 * (1 + 5 / max(count - 2, 1))
    spread = scale * max(float(np.median(sizes(best))), 1e-6)
    for _ in range(iterations):
        t = np.sqrt(2 * (1 - np.cos(sizes(best)))) / spread / _ANDREWS
        renewed = np.where(t < np.pi, np.sinc(t / np.pi), 0.0)
        if np.count_nonzero(renewed > 0) < 3:
            break
        moved, _ = _ascend(place, azimuth, renewed, best)
        settled = np.abs(renewed - weights).max() < 1e-9
        weights, best = renewed, moved
        if settled:
            break
        spread = scale * max(float(np.median(sizes(best))), 1e-6)
    return _fix(place, azimuth, weights, best[None])
