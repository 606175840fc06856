"""Robust least squares of one object's oscillator and along-track time, and how well it explains the rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Fit", "correlation_time", "fitted", "own_scale"]

Array = NDArray[np.float64]

_FREEDOM = 4.0  # of the t distribution of a block's median
_STEPS = 50
_CLOSE = 1e-6  # of a sigma


@dataclass(frozen=True, eq=False)
class Fit:
    """What is left of one object.

    Attributes
    ----------
    estimate : ndarray, shape (n,)
        Parameters.
    covariance : ndarray, shape (n, n)
    residual : ndarray, shape (blocks,)
        [m/s]
    likelihood : float
        Logarithm of the probability of the rows, parameters integrated out (Laplace's approximation), but for a
        constant that all objects share.
    peak : float
        The same at the most likely parameters.
    """

    estimate: Array
    covariance: Array
    residual: Array
    likelihood: float
    peak: float

    @property
    def sigma(self) -> Array:
        """Standard deviations of the parameters, shape (n,)."""
        deviations: Array = np.sqrt(np.diagonal(self.covariance))
        return deviations


def own_scale(design: Array, value: Array, prior: Array, center: Array) -> float:
    """Return the scale of the t distribution that a single object's residuals have, by maximum likelihood (EM)."""
    scale = max(float(np.std(value - value.mean())), 1e-6)
    weight = np.ones_like(value)
    before = np.diag(prior**-2.0)
    for _ in range(_STEPS):
        part = (weight / scale**2)[:, None] * design
        rest = value - design @ np.linalg.solve(part.T @ design + before, part.T @ value + center / prior**2)
        weight = (_FREEDOM + 1) / (_FREEDOM + (rest / scale) ** 2)
        new = max(float(np.sqrt(np.mean(weight * rest**2))), 1e-6)
        done = abs(new - scale) < 1e-4 * scale
        scale = new
        if done:
            break
    return scale


def fitted(design: Array, value: Array, prior: Array, center: Array, scale: float, together: float) -> Fit:
    r"""Fit the parameters of an object under a given scale.

    Parameters
    ----------
    design : ndarray, shape (blocks, n)
    value : ndarray, shape (blocks,)
        Medians of what was measured less what is predicted [m/s].
    prior, center : ndarray, shape (n,)
        Standard deviations of the parameters before, and their means.
    scale : float
        Of the t distribution with 4 degrees of freedom of a median [m/s].
    together : float
        How many blocks say the same: the likelihood is that of blocks / together independent ones.

    Returns
    -------
    Fit
        Its likelihood is :math:`\ln p(y|\hat\theta) - \frac12 \sum ((\hat\theta-\mu)/\sigma)^2 - \frac12 \ln
        \det(\Sigma H)`, H the curvature with the prior's (Laplace's approximation; Kass and Raftery, 1995).
    """
    estimate, curvature = _solve(design, value, prior, center, scale, together)
    rest = value - design @ estimate
    explained = -0.5 * (_FREEDOM + 1) * float(np.sum(np.log1p((rest / scale) ** 2 / _FREEDOM))) / together
    drawn = -0.5 * float(np.sum(((estimate - center) / prior) ** 2))
    spread = -0.5 * float(np.linalg.slogdet(curvature * np.outer(prior, prior))[1])
    scaled = np.linalg.inv(curvature * np.outer(prior, prior)) * np.outer(prior, prior)
    return Fit(estimate, scaled, rest, explained + drawn + spread, explained + drawn)


def _solve(
    design: Array, value: Array, prior: Array, center: Array, scale: float, together: float
) -> tuple[Array, Array]:
    """Return the most likely parameters and the curvature there, by iterated reweighting."""
    estimate: Array = center.copy()
    weight = np.ones_like(value)
    before = np.diag(prior**-2.0)
    curvature: Array = before
    for step in range(_STEPS):
        part = (weight / (together * scale**2))[:, None] * design
        curvature = part.T @ design + before
        new = np.asarray(np.linalg.solve(curvature, part.T @ value + center / prior**2), dtype=np.float64)
        moved = float(np.max(np.abs(new - estimate) / prior))
        estimate = new
        if step and moved < _CLOSE:
            break
        rest = value - design @ estimate
        weight = (_FREEDOM + 1) / (_FREEDOM + (rest / scale) ** 2)
    return estimate, curvature


def correlation_time(rest: Array) -> float:
    """Return how many neighbours say the same: 1 + 2 sum of the correlations, up to the first pair below zero.

    Large residuals are clipped at three robust sigmas (Geyer's initial positive sequence, 1992).
    """
    limit = 3 * 1.4826 * float(np.median(np.abs(rest)))
    x = np.clip(rest, -limit, limit)
    x = x - x.mean()
    power = float(x @ x)
    if power <= 0:
        return 1.0
    total = 1.0
    for lag in range(1, rest.size // 2, 2):
        pair = [float(x[: x.size - k] @ x[k:]) / power for k in (lag, lag + 1)]
        if sum(pair) <= 0:
            break
        total += 2 * sum(pair)
    return max(total, 1.0)
