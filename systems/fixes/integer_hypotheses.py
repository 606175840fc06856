r"""Which whole cycles of wrapped phases the first epoch allows, each with the position it means.

The delays leave a curve, the assumed height a stretch of it. Along that stretch the unambiguous phases pass through
one or many cycles; every set of integers that is met is a hypothesis. It is then a least-squares problem without
ambiguity, delays, phases and height together, whose solution and covariance start a filter of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angle_wrapping import wrap
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import ecef_to_geodetic
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.fixes.delay_curve import delay_curve
from quietfix.systems.linear_algebra import inverses, solve
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.stack import Stack

__all__ = ["IntegerHypotheses", "integer_covariance", "integer_hypotheses", "integer_slope"]

Array = NDArray[np.float64]

_SPACING = np.pi / 2  # rad between points: a quarter of a cycle, so that none is skipped
_ITERATIONS = 30
_CONVERGED = 1e-2  # m


@dataclass(frozen=True)
class IntegerHypotheses:
    """Hypotheses about the integers, K per trial, the likeliest height first; NaN where there are fewer.

    Attributes
    ----------
    position : ndarray, shape (trials, K, 3)
        Earth-fixed [m].
    covariance : ndarray, shape (trials, K, 3, 3)
        Of the position [m^2].
    weight : ndarray, shape (trials, K)
        Probability given the first epoch, sum 1; 0 where there is no hypothesis, all 0 in a trial that has none.
    integers : ndarray, shape (trials, K, m)
        Whole cycles to be added to the phases wrapped into [-pi, pi).
    """

    position: Array
    covariance: Array
    weight: Array
    integers: Array


def integer_hypotheses(
    delays: MeasurementModel,
    phases: MeasurementModel,
    measured_delays: Array,
    measured_phases: Array,
    platforms: Array,
    height: Array,
    sigma_height: float,
    count: int,
    sigma_range: float = 0.0,
) -> IntegerHypotheses:
    r"""Enumerate the integers that one epoch allows.

    The weight of a hypothesis is its probability given delays, phases and height, by Laplace's method, where all
    horizontal places are equally likely beforehand:
    :math:`w \propto |P|^{1/2} \exp(-\chi^2/2)`.

    Parameters
    ----------
    delays : MeasurementModel
        Two TDOAs [s], as believed.
    phases : MeasurementModel
        Unambiguous phases [rad], as believed.
    measured_delays : ndarray, shape (trials, 2)
    measured_phases : ndarray, shape (trials, m)
        Whole cycles in them do not matter.
    platforms : ndarray, shape (1 or trials, p, 6)
        Platforms, Earth-fixed.
    height : ndarray, shape (trials,)
        Assumed height above the WGS-84 ellipsoid [m].
    sigma_height : float
        Its standard deviation [m].
    count : int
        K: of more hypotheses than that, those nearest to the assumed height are kept.
    sigma_range : float
        Standard deviation of a range through the error of its platform [m]; the reference's error is in both delays.

    Returns
    -------
    IntegerHypotheses
    """
    wrapped = wrap(measured_phases)
    points = delay_curve(delays, measured_delays, platforms, height, sigma_height, phases, _SPACING)
    integers, start = _met(phases, wrapped, points, platforms, height, sigma_height, count)
    stack, whitener = _together(delays, phases, sigma_height, sigma_range)
    trials = wrapped.shape[0]
    measured = np.concatenate(
        [
            np.broadcast_to(measured_delays[:, None], (trials, count, 2)),
            wrapped[:, None] + 2 * np.pi * integers,
            np.broadcast_to(height[:, None, None], (trials, count, 1)),
        ],
        axis=-1,
    )
    position, covariance, cost = _least_squares(stack, whitener, measured, platforms[:, None], start)
    with np.errstate(invalid="ignore"):  # NaN where there is no hypothesis
        log_weight = 0.5 * (np.linalg.slogdet(covariance)[1] - cost)
    log_weight = np.where(np.isfinite(log_weight), log_weight, -np.inf)
    best = log_weight.max(axis=-1, keepdims=True)
    weight = np.where(np.isfinite(best), np.exp(log_weight - np.where(np.isfinite(best), best, 0.0)), 0.0)
    total = weight.sum(axis=-1, keepdims=True)
    return IntegerHypotheses(position, covariance, weight / np.where(total > 0, total, 1.0), integers)


def integer_covariance(
    delays: MeasurementModel,
    phases: MeasurementModel,
    target: Array,
    platforms: Array,
    sigma_height: float,
    sigma_range: float = 0.0,
) -> Array:
    """Return the covariance of the position (..., 3, 3) at `target` (..., 6), the integers being right.

    The other arguments are those of `integer_hypotheses`. NaN where the target is NaN.
    """
    stack, whitener = _together(delays, phases, sigma_height, sigma_range)
    rows = whitener.matrix(None) @ stack.jacobian(target, platforms)[..., :3]
    finite = np.all(np.isfinite(rows), axis=(-1, -2))[..., None, None]
    return np.where(finite, inverses(np.where(finite, np.swapaxes(rows, -1, -2) @ rows, np.eye(3))), np.nan)


def integer_slope(
    delays: MeasurementModel,
    phases: MeasurementModel,
    target: Array,
    platforms: Array,
    sigma_height: float,
    sigma_range: float = 0.0,
) -> Array:
    r"""Return dp/dv of the least-squares position at given measurements, shape (..., 3, 3) [s].

    :math:`-(H_p^T R^{-1} H_p)^{-1} H_p^T R^{-1} H_v`: 0 where no row depends on the velocity. The arguments are those
    of `integer_covariance`.
    """
    stack, whitener = _together(delays, phases, sigma_height, sigma_range)
    rows = whitener.matrix(None) @ stack.jacobian(target, platforms)
    finite = np.all(np.isfinite(rows), axis=(-1, -2))[..., None, None]
    place, velocity = rows[..., :3], np.where(finite, rows[..., 3:6], 0.0)
    turned = np.swapaxes(place, -1, -2)
    information = np.where(finite, turned @ place, np.eye(3))
    return np.where(finite, -solve(information, np.where(finite, turned, 0.0) @ velocity), np.nan)


def _together(
    delays: MeasurementModel, phases: MeasurementModel, sigma_height: float, sigma_range: float
) -> tuple[Stack, Whitener]:
    """Return delays, phases and height as one measurement, and its noise."""
    stack = Stack([delays, phases, Altitude(sigma_height)])
    noise = stack.noise_covariance()
    noise[:2, :2] += (sigma_range / SPEED_OF_LIGHT) ** 2 * (np.eye(2) + np.ones((2, 2)))
    return stack, Whitener(noise)


def _met(
    phases: MeasurementModel,
    wrapped: Array,
    points: Array,
    platforms: Array,
    height: Array,
    sigma_height: float,
    count: int,
) -> tuple[Array, Array]:
    """Return up to `count` sets of integers that the points meet (trials, K, m), and the best point of each."""
    target = np.concatenate([points, np.zeros_like(points)], axis=-1)
    turns = (phases.predict(target, platforms[:, None]) - wrapped[:, None]) / (2 * np.pi)
    met = np.round(turns)
    # The points are a spacing apart, so a phase need not be met better than that.
    off = 2 * np.pi * (turns - met) / np.hypot(phases.sigmas, _SPACING)
    cost = ((ecef_to_geodetic(points)[2] - height[:, None]) / sigma_height) ** 2 + (off**2).sum(axis=-1)
    cost = np.where(np.isfinite(cost), cost, np.inf)
    rows = np.arange(wrapped.shape[0])
    integers = np.full((wrapped.shape[0], count, wrapped.shape[1]), np.nan)
    start = np.full((wrapped.shape[0], count, 3), np.nan)
    for k in range(count):
        best = np.argmin(cost, axis=1)
        there = np.isfinite(cost[rows, best])
        if not there.any():
            break
        chosen = met[rows, best]
        integers[there, k], start[there, k] = chosen[there], points[rows, best][there]
        cost = np.where((met == chosen[:, None]).all(axis=-1), np.inf, cost)
    return integers, start


def _least_squares(
    model: MeasurementModel, whitener: Whitener, measured: Array, platforms: Array, start: Array
) -> tuple[Array, Array, Array]:
    """Return position (..., 3), covariance and chi-square by Gauss-Newton; NaN where it does not converge."""
    w = whitener.matrix(None)
    position = np.where(np.isfinite(start), start, 1.0)
    moving = np.all(np.isfinite(start), axis=-1)
    settled = np.zeros_like(moving)
    for _ in range(_ITERATIONS):
        residual, rows, information = _normal(model, w, measured, platforms, position)
        step = solve(
            np.where(moving[..., None, None], information, np.eye(3)),
            np.einsum("...mi,...m->...i", rows, np.where(moving[..., None], residual, 0.0))[..., None],
        )[..., 0]
        position = np.where(moving[..., None], position + step, position)
        done = moving & (np.einsum("...i,...i->...", step, step) <= _CONVERGED**2)
        settled |= done
        moving &= ~done & np.isfinite(position).all(axis=-1)
        if not moving.any():
            break
    residual, rows, information = _normal(model, w, measured, platforms, position)
    covariance = inverses(np.where(settled[..., None, None], information, np.eye(3)))
    cost = np.einsum("...m,...m->...", residual, residual)
    return (
        np.where(settled[..., None], position, np.nan),
        np.where(settled[..., None, None], covariance, np.nan),
        np.where(settled, cost, np.nan),
    )


def _normal(
    model: MeasurementModel, w: Array, measured: Array, platforms: Array, position: Array
) -> tuple[Array, Array, Array]:
    value, jacobian = model.linearize(np.concatenate([position, np.zeros_like(position)], axis=-1), platforms)
    rows = w @ jacobian[..., :3]
    residual = np.einsum("ij,...j->...i", w, model.residual(measured, value))
    return residual, rows, np.swapaxes(rows, -1, -2) @ rows
