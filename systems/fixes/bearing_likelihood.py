"""Maximum likelihood from many bearings of a target that stands or moves straight."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angles.bearing import Bearing
from quietfix.systems.linear_algebra import dot

__all__ = ["BearingHistory", "Fit", "QuadraticPrior", "fold", "maximum_likelihood"]

Array = NDArray[np.float64]

_FIRST_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-3, 1e-9, 1e9
_SINGULAR = 1e-13  # smallest eigenvalue of the information, scaled to unit diagonal


class BearingHistory(NamedTuple):
    """Bearings of the past, over leading axes.

    Attributes
    ----------
    angles : ndarray, shape (..., k, m)
        Measurements [rad]; NaN where one is missing.
    places : ndarray, shape (..., k, axes)
        Where they were taken [m].
    ages : ndarray, shape (..., k)
        How long ago [s]; not read for a target at rest.
    directions : tuple of ndarray, shape (..., k)
        Cosine and sine of the azimuths; use `of`.
    """

    angles: Array
    places: Array
    ages: Array
    directions: tuple[Array, Array]

    @classmethod
    def of(cls, angles: Array, places: Array, ages: Array | None = None) -> BearingHistory:
        """Return the history; see the class."""
        azimuth = angles[..., 0]
        return cls(angles, places, np.zeros((1, 1)) if ages is None else ages, (np.cos(azimuth), np.sin(azimuth)))

    def take(self, rows: NDArray[np.intp]) -> BearingHistory:
        """Return the history of some trials; what all share stays as it is."""

        def some(array: Array) -> Array:
            return array if array.shape[0] == 1 else array[rows]

        cosine, sine = self.directions
        return BearingHistory(some(self.angles), some(self.places), some(self.ages), (some(cosine), some(sine)))


class QuadraticPrior(NamedTuple):
    r"""What is known besides the history: a cost :math:`\tfrac12 (x - a)^T J (x - a) - b^T (x - a)`.

    J may be singular: bearings folded in one by one do not determine a mean at first.

    Attributes
    ----------
    anchor, vector : ndarray, shape (..., n)
        a and b.
    information : ndarray, shape (..., n, n)
        J.
    """

    anchor: Array
    vector: Array
    information: Array


class Fit(NamedTuple):
    """A maximum-likelihood fit, over leading axes.

    Attributes
    ----------
    state : ndarray, shape (..., n)
        Now.
    covariance : ndarray, shape (..., n, n)
        Inverse of the information at the fit; NaN where the bearings do not determine the state.
    cost : ndarray, shape (...)
        Half the sum of squared, weighted residuals.
    """

    state: Array
    covariance: Array
    cost: Array


def _terms(
    state: Array, history: BearingHistory, model: Bearing, prior: QuadraticPrior | None
) -> tuple[Array, Array, Array]:
    """Return cost (...), gradient of minus the cost (..., n) and information (..., n, n)."""
    n, axes = state.shape[-1], history.places.shape[-1]
    rows, residual = (_azimuths if model.size == 1 else _all_angles)(state, history, model)
    if n > axes and model.size == 1:
        rows += [-history.ages * row for row in rows]
    gradient = np.stack([dot(row, residual) for row in rows], axis=-1)
    information = np.empty((*gradient.shape, n))
    for i, row in enumerate(rows):
        for j in range(i + 1):
            information[..., i, j] = information[..., j, i] = dot(row, rows[j])
    cost = 0.5 * dot(residual, residual)
    if prior is not None:
        off = state - prior.anchor
        pulled = np.einsum("...ij,...j->...i", prior.information, off)
        cost = cost + np.einsum("...i,...i->...", off, 0.5 * pulled - prior.vector)
        gradient = gradient + prior.vector - pulled
        information = information + prior.information
    return cost, gradient, information


def _azimuths(state: Array, history: BearingHistory, model: Bearing) -> tuple[list[Array], Array]:
    """Return derivatives with respect to x and y, and residuals, (..., k), over sigma; component by component.

    A thousand bearings of a hundred trials are fitted at every epoch: this is where the time goes. Turning the offset
    into the axes of the line of bearing gives a residual that is wrapped already.
    """
    x, y = state[..., None, 0], state[..., None, 1]
    if state.shape[-1] > 2:
        x, y = x - history.ages * state[..., None, 2], y - history.ages * state[..., None, 3]
    dx, dy = x - history.places[..., 0], y - history.places[..., 1]
    cosine, sine = history.directions
    residual = np.arctan2(sine * dx - cosine * dy, cosine * dx + sine * dy)
    square = dx * dx
    square += dy * dy
    square *= model.sigma
    with np.errstate(divide="ignore", invalid="ignore"):
        np.divide(1.0, square, out=square)
        rows = [-dy * square, dx * square]
    residual /= model.sigma
    if not np.isfinite(residual.sum() + square.sum()):
        there = np.isfinite(residual) & np.isfinite(square)
        residual = np.where(there, residual, 0.0)
        rows = [np.where(there, row, 0.0) for row in rows]
    return rows, residual


def _all_angles(state: Array, history: BearingHistory, model: Bearing) -> tuple[list[Array], Array]:
    """Return derivatives with respect to the state, and residuals, (..., k * m), over sigma, for any angles."""
    n, axes = state.shape[-1], history.places.shape[-1]
    past = state[..., None, :axes]
    if n > axes:
        past = past - history.ages[..., None] * state[..., None, axes:]
    value, rows = model.linearize(past, history.places[..., None, :])
    residual = model.residual(history.angles, value) / model.sigmas
    there = np.isfinite(residual) & np.isfinite(rows[..., 0])
    rows = np.where(there[..., None], rows / model.sigmas[:, None], 0.0)
    if n > axes:
        rows = np.concatenate([rows, -history.ages[..., None, None] * rows], axis=-1)
    flat = rows.reshape(*rows.shape[:-3], -1, n)
    return [flat[..., i] for i in range(n)], np.where(there, residual, 0.0).reshape(flat.shape[:-1])


def fold(prior: QuadraticPrior, state: Array, history: BearingHistory, model: Bearing) -> QuadraticPrior:
    """Return the prior with a history put into it, linearised at `state`.

    Parameters
    ----------
    prior : QuadraticPrior
    state : ndarray, shape (..., n)
        Near the truth by then.
    history : BearingHistory
        What is to be forgotten; all NaN changes nothing.
    model : Bearing

    Returns
    -------
    QuadraticPrior
    """
    _, gradient, information = _terms(state, history, model, None)
    pulled = np.einsum("...ij,...j->...i", information, state - prior.anchor)
    return QuadraticPrior(prior.anchor, prior.vector + gradient + pulled, prior.information + information)


def maximum_likelihood(
    history: BearingHistory,
    model: Bearing,
    start: Array,
    prior: QuadraticPrior | None = None,
    iterations: int = 30,
    converged: float = 1e-3,
    most_distant: float = 1e6,
) -> Fit:
    r"""Return the maximum-likelihood state by Levenberg's and Marquardt's damped Gauss-Newton iteration.

    .. math:: \hat x = \arg\min_x \sum_k \frac{\mathrm{wrap}^2(z_k - h_k(x))}{2\sigma^2}

    Marquardt, *An algorithm for least-squares estimation of nonlinear parameters*, J. SIAM 11 (1963) 431-441. A trial
    whose step would raise its cost is damped more and keeps its place; it stops when a step would change its cost
    by less than `converged`. None changes another's result.

    Parameters
    ----------
    history : BearingHistory
        Leading axes (trials,).
    model : Bearing
        Sensor as it is believed.
    start : ndarray, shape (trials, n)
        Position, or position and velocity, now; a NaN gives NaN.
    prior : QuadraticPrior, optional
        What is known besides.
    iterations : int
        At most so many.
    converged : float
        Predicted decrease of the cost at which a trial stops; 1e-3 is a step of 0.04 standard deviations.
    most_distant : float
        A step may not lead further from the last platform than this [m]: where all bearings are nearly parallel the
        likelihood rises towards infinity.

    Returns
    -------
    Fit
    """
    state = np.array(start, dtype=float)
    trials, n = state.shape
    axes = history.places.shape[-1]
    cost, gradient, information = _terms(state, history, model, prior)
    damping = np.full(trials, _FIRST_DAMPING)
    active = np.flatnonzero(np.all(np.isfinite(state), axis=-1))
    centre = np.broadcast_to(np.nan_to_num(history.places[:, 0]), (trials, axes))
    for _ in range(iterations):
        if active.size == 0:
            break
        j, g = information[active], gradient[active]
        diagonal = np.einsum("...ii->...i", j)
        floor = 1e-12 * np.maximum(diagonal.max(axis=-1), 1e-300)
        scale = np.maximum(diagonal, floor[:, None])
        damped = j + (damping[active, None] * scale)[..., None] * np.eye(n)
        step = np.linalg.solve(damped, g[..., None])[..., 0]
        gain = 0.5 * np.einsum("...i,...i->...", step, g + damping[active, None] * scale * step)
        trial_state = state[active] + step
        far = np.linalg.norm(trial_state[:, :axes] - centre[active], axis=-1) > most_distant
        part = history if active.size == trials else history.take(active)
        belief = None if prior is None else QuadraticPrior(*(field[active] for field in prior))
        new_cost, new_gradient, new_information = _terms(trial_state, part, model, belief)
        better = (new_cost <= cost[active]) & ~far
        taken = active[better]
        state[taken] = trial_state[better]
        cost[taken], gradient[taken] = new_cost[better], new_gradient[better]
        information[taken] = new_information[better]
        factor = np.where(better, 0.1, 10.0)
        damping[active] = np.clip(damping[active] * factor, _LEAST_DAMPING, _MOST_DAMPING)
        done = (better & (gain < converged)) | (gain < 1e-12) | (damping[active] >= _MOST_DAMPING)
        active = active[~done]
    return Fit(state, _inverse(information), np.where(np.all(np.isfinite(state), axis=-1), cost, np.nan))


def _inverse(information: Array) -> Array:
    """Return the inverse, NaN where the information is singular."""
    scale = np.sqrt(np.einsum("...ii->...i", information))
    known = np.all(np.isfinite(information), axis=(-1, -2)) & (scale > 0).all(axis=-1)
    n = information.shape[-1]
    safe = np.where(known[:, None], scale, 1.0)
    unit = np.where(known[:, None, None], information / (safe[:, :, None] * safe[:, None, :]), np.eye(n))
    regular = known & (np.linalg.eigvalsh(unit)[:, 0] > _SINGULAR)
    unit = np.where(regular[:, None, None], unit, np.eye(n))
    inverse = np.linalg.inv(unit) / (safe[:, :, None] * safe[:, None, :])
    return np.where(regular[:, None, None], 0.5 * (inverse + np.swapaxes(inverse, -1, -2)), np.nan)
