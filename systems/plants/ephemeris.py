"""An ephemeris of positions and velocities, between its samples."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.plants.recorded import hermite
from quietfix.systems.trajectories.polynomial import ORBIT_ORDER, polynomial_states

__all__ = ["hermite_states", "spline_samples"]

Array = NDArray[np.float64]

_NODES = 6  # of the polynomials of a short ephemeris: order 11
_COARSE, _FINE = 0.5, 0.01  # m, error of a cubic spline between samples: the most, and what samples between leave
_ROUNDED = 0.01  # m/s between a velocity and the positions around it: more is a model's own, as in SGP4
_WRONG = 1e-3  # of the speed: more is a mistake


def hermite_states(times: Array, states: Array, at: Array, nodes: int = _NODES) -> Array:
    r"""Interpolate by the polynomial that has position and velocity at the nearest samples.

    Newton's formula with every node twice: with n of them it is of order 2 n - 1, and off by
    :math:`x^{(2n)} \prod_j (t - t_j)^2 / (2n)!` (Davis, *Interpolation and Approximation*, 1975, section 3.1).

    Parameters
    ----------
    times : ndarray, shape (samples,)
        Strictly increasing [s].
    states : ndarray, shape (samples, 6)
        Position and velocity.
    at : ndarray, shape (k,)
        Where to interpolate [s], not outside.
    nodes : int
        How many samples, at most all.

    Returns
    -------
    ndarray, shape (k, 6)
        The polynomial and its derivative.
    """
    count = min(nodes, times.size)
    nearest = np.searchsorted(0.5 * (times[1:] + times[:-1]), at)
    window = np.clip(nearest - count // 2, 0, times.size - count)[:, None] + np.arange(count)
    middle = states[nearest, :3]  # subtracted: large coordinates do not cancel
    z = np.repeat(times[window] - at[:, None], 2, axis=1)
    column = np.repeat(states[window, :3] - middle[:, None], 2, axis=1)
    newton = [column[:, 0]]
    for order in range(1, 2 * count):
        span = (z[:, order:] - z[:, :-order])[..., None]
        rise = column[:, 1:] - column[:, :-1]
        if order == 1:
            span[:, ::2] = 1.0
            rise[:, ::2] = states[window, 3:]
        column = rise / span
        newton.append(column[:, 0])
    value, slope = newton[-1], np.zeros_like(middle)
    for i in range(len(newton) - 2, -1, -1):  # Horner's rule at 0, and its derivative
        slope = value - z[:, i, None] * slope
        value = newton[i] - z[:, i, None] * value
    return np.concatenate([middle + value, slope], axis=-1)


def _between(times: Array, states: Array, at: Array) -> tuple[Array, Array]:
    """Return states between samples, and how far those of a lower order are from them [m]."""
    nodes = min(_NODES, times.size)
    found = hermite_states(times, states, at, nodes)
    lower = hermite_states(times, states, at, nodes - 2 if nodes > 4 else nodes - 1)
    doubt = np.linalg.norm((found - lower)[:, :3], axis=-1)
    if times.size > ORBIT_ORDER:
        other = polynomial_states(times, states[:, :3], at)
        lower = polynomial_states(times, states[:, :3], at, ORBIT_ORDER - 2)
        off = np.linalg.norm((other - lower)[:, :3], axis=-1)
        taken = off <= _COARSE
        found[taken], doubt[taken] = other[taken], off[taken]
    return found, doubt


def spline_samples(times: Array, states: Array) -> tuple[Array, Array]:
    """Add samples until a cubic Hermite spline through them is within 0.5 m of the motion.

    Between samples it is the polynomial of order 10 through the nearest positions; where one of order 8 is 0.5 m off
    that (near the ends of long steps), and of fewer than 11 samples, it is that of `hermite_states`. Where one of a
    lower order is 0.5 m off that too, a NaN between two samples marks the gap. Velocities
    that are 0.01 m/s off the derivative of the positions, as SGP4's are, give way to it.

    Parameters
    ----------
    times : ndarray, shape (samples,)
        Strictly increasing [s], at least two.
    states : ndarray, shape (samples, 6)
        Position [m] and velocity [m/s] in axes that do not turn.

    Returns
    -------
    times : ndarray, shape (more,)
    states : ndarray, shape (more, 6)

    Raises
    ------
    ValueError
        For one sample, and for velocities that are off the derivative of the positions by 0.1 % and 1 m/s.
    """
    if times.size < 2:
        raise ValueError(f"{times.size} sample is not allowed; at least 2")
    states = _agreeing(times, states)
    steps, middles = np.diff(times), 0.5 * (times[1:] + times[:-1])
    exact, doubt = _between(times, states, middles)
    gap = ~(doubt <= _COARSE)
    spline = np.array([hermite(times, states, middle)[0][:3] for middle in middles])
    worst = float(np.max(np.linalg.norm(spline - exact[:, :3], axis=-1)[~gap], initial=0.0))
    parts = int(np.ceil((worst / _FINE) ** 0.25)) if worst > _COARSE else 1  # its error falls with the step's 4th power
    share = np.arange(1, parts) / parts
    between = (times[:-1, None] + share * steps[:, None])[~gap].ravel()
    more = _between(times, states, between)[0] if between.size else np.empty((0, 6))
    all_times = np.concatenate([times, middles[gap], between])
    all_states = np.concatenate([states, np.full((np.count_nonzero(gap), 6), np.nan), more])
    order = np.argsort(all_times)
    return all_times[order], all_states[order]


def _agreeing(times: Array, states: Array) -> Array:
    """Return states whose velocities are those of the positions, as far as these tell."""
    if times.size <= ORBIT_ORDER:
        return states
    known = polynomial_states(times, states[:, :3], times)[:, 3:]
    lower = polynomial_states(times, states[:, :3], times, ORBIT_ORDER - 2)[:, 3:]
    off = np.linalg.norm(states[:, 3:] - known, axis=-1) - 10 * np.linalg.norm(known - lower, axis=-1)
    at = int(np.argmax(off))
    if off[at] > max(_WRONG * float(np.linalg.norm(known[at])), 1.0):
        raise ValueError(f"the velocity at sample {at + 1} is {off[at]:.3g} m/s off what the positions around it say")
    return np.concatenate([states[:, :3], np.where((off > _ROUNDED)[:, None], known, states[:, 3:])], axis=-1)
