"""Position and velocity from samples of the position, by the polynomial through the nearest ones."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["ORBIT_ORDER", "polynomial_states"]

Array = NDArray[np.float64]

ORBIT_ORDER = 10
"""Order that serves satellites: at 60 s in low orbit and at 900 s in that of GPS the truncation is below rounding."""


def polynomial_states(
    times: Array,
    positions: Array,
    at: Array,
    order: int = ORBIT_ORDER,
    fewest: int | None = None,
    longest_step: float = math.inf,
) -> Array:
    r"""Interpolate positions, and differentiate the interpolation.

    Lagrange's formula on the ``order + 1`` samples nearest to each time, :math:`x(t) = \sum_j l_j(t)\,x_j` and
    :math:`\dot x(t) = \sum_j \dot l_j(t)\,x_j`. At a sample the velocity is off by
    :math:`x^{(n+1)}\,|\prod_{j\ne k}(t_k - t_j)|/(n+1)!` for order n: with n = 10 and equal steps h, 1/2772 of
    :math:`h^{10} x^{(11)}` in the middle of the record and 1/11 at its ends.

    Parameters
    ----------
    times : ndarray, shape (samples,)
        Strictly increasing [s].
    positions : ndarray, shape (samples, d)
        A NaN is a gap; no polynomial crosses one.
    at : ndarray, shape (k,)
        Where to interpolate [s].
    order : int
        Of the polynomials.
    fewest : int, optional
        A stretch between gaps with at least so many samples, but not enough for `order`, gets a polynomial through
        all of them; one with fewer gets none. By default only `order` will do.
    longest_step : float
        A longer time between samples is a gap too [s].

    Returns
    -------
    ndarray, shape (k, 2 d)
        Position and velocity; NaN in gaps and outside the record.
    """
    found = np.full((at.size, 2 * positions.shape[1]), np.nan)
    known = np.flatnonzero(np.isfinite(positions).all(axis=-1))
    ends = np.flatnonzero((np.diff(known) > 1) | (np.diff(times[known]) > longest_step)) + 1
    for stretch in np.split(known, ends):
        count = min(order + 1, stretch.size)
        if count < max(1, order + 1 if fewest is None else fewest):
            continue
        t = times[stretch]
        asked = np.flatnonzero((at >= t[0]) & (at <= t[-1]))
        nearest = np.searchsorted(0.5 * (t[1:] + t[:-1]), at[asked])
        window = np.clip(nearest - count // 2, 0, stretch.size - count)[:, None] + np.arange(count)
        value, slope = _lagrange(t[window] - at[asked, None])
        middle = positions[stretch[nearest]]  # subtracted: large coordinates do not cancel
        off = positions[stretch[window]] - middle[:, None]
        found[asked] = np.concatenate(
            [middle + np.einsum("kj,kjd->kd", value, off), np.einsum("kj,kjd->kd", slope, off)], axis=-1
        )
    return found


def _lagrange(nodes: Array) -> tuple[Array, Array]:
    """Return the weights (k, n) of value and derivative at 0 of the polynomials through `nodes` (k, n)."""
    scale = np.abs(nodes).max(axis=-1, keepdims=True)
    scaled = nodes / np.where(scale > 0, scale, 1.0)
    count = nodes.shape[-1]
    value, slope = np.ones_like(scaled), np.zeros_like(scaled)
    # the product of (0 - x_m)/(x_j - x_m) over m, and its derivative by the rule for products, one factor at a time
    for m in range(count):
        others = np.arange(count) != m
        reach = scaled[:, others] - scaled[:, m : m + 1]
        slope[:, others] = (slope[:, others] * -scaled[:, m : m + 1] + value[:, others]) / reach
        value[:, others] *= -scaled[:, m : m + 1] / reach
    return value, slope / np.where(scale > 0, scale, 1.0)
