r"""The range of a satellite from one instant of angles, rates and radial acceleration.

Wu, Xin and Wan, *Progress in Natural Science* (in Chinese, 2008), sections 2 and 3, with J2 as in 4.4; the signs are
derived here, since many of the printed ones cannot be right. With :math:`e` the direction of the target and
:math:`w_2 = (\dot\beta\cos\epsilon)^2 + \dot\epsilon^2`, the radial component of the relative acceleration gives

.. math:: f(r) = w_2 r + e\cdot a(r_O + r e) - e\cdot a(r_O) - \ddot r = 0

(the paper's (23) prints :math:`(\dot\beta\cos\epsilon)^2 - \dot\epsilon^2`; with it the true range is not a root).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angles.relative_kinematics import SightAxes, sight_axes
from quietfix.systems.kernels.loading import ready
from quietfix.systems.trajectories.gravity import GravityConstants, acceleration, energy, gradient

__all__ = ["RangingEquation"]

Array = NDArray[np.float64]

_SMALLEST = 1e-24  # rad^2/s^2; keeps the outermost bracket finite when nothing turns
_ALONG = ("p", "d2", "z", "ez", "turn", "k")  # what says where a line is and what was measured along it


@dataclass(frozen=True)
class _Line:
    """The equation along a line of sight, as a function of s = r + p, the distance from its foot; shapes (..., 1)."""

    p: Array
    d2: Array
    z: Array
    ez: Array
    turn: Array
    k: Array
    mu: float
    bulge: float

    @cached_property
    def _rows(self) -> Array:
        return np.array([getattr(self, name).ravel() for name in _ALONG])

    def _evaluate(self, slope: bool, s: Array) -> Array:
        shape = np.broadcast_shapes(s.shape, self.p.shape)
        if shape[:-1] != self.p.shape[:-1]:
            lead = (*shape[:-1], 1)
            wider: dict[str, Any] = {name: np.broadcast_to(getattr(self, name), lead) for name in _ALONG}
            return replace(self, **wider)._evaluate(slope, s)
        places = _columns(np.broadcast_to(s, shape))
        out = np.empty_like(places)
        ready("ranging.line:evaluate")(slope, self._rows, self.mu, self.bulge, places, out)
        return _uncolumns(out, shape)

    def value(self, s: Array) -> Array:
        """Return f, shape (..., m) for s (..., m)."""
        return self._evaluate(False, s)

    def slope(self, s: Array) -> Array:
        """Return df/dr; times :math:`r_T^5` it is the paper's Dm, (35) with its square restored."""
        return self._evaluate(True, s)

    def halve(self, slope: bool, low: Array, high: Array, rising: Array, halvings: int = 52) -> Array:
        """Return where f, or its slope, changes sign in intervals (..., m) in which it rises (1) or falls (-1).

        Halving, not Newton's iteration: near a double root that is slow, and the slowest of all trials sets the pace.
        52 times is to the last bit of the interval's length.
        """
        half = 0.5 * (high - low)
        places = _columns(low + half)
        ready("ranging.line:halve")(slope, self._rows, self.mu, self.bulge, rising, halvings, _columns(half), places)
        return _uncolumns(places, half.shape)


def _columns(array: Array) -> Array:
    """Return (..., m) as (m, lines), a copy."""
    return np.array(array.reshape(-1, array.shape[-1]).T, order="C")


def _uncolumns(array: Array, shape: tuple[int, ...]) -> Array:
    return np.array(array.T, order="C").reshape(shape)


class RangingEquation:
    """Solves the ranging equation and says how good its roots are.

    Measurements are (..., 6) in the order of `quietfix.systems.angles.relative_kinematics.ROWS`, the observer is its
    inertial state (..., 6); a measurement with NaN has no roots.

    Parameters
    ----------
    constants : GravityConstants, optional
        Constants of the Earth.
    j2 : bool
        Whether the flattening of the Earth acts on both satellites.
    """

    def __init__(self, constants: GravityConstants | None = None, j2: bool = False) -> None:
        self.constants = constants or GravityConstants()
        self.j2 = bool(j2) and self.constants.j2 != 0

    # ---- the equation

    def _line(self, measurement: Array, observer: Array) -> _Line:
        m, place = np.asarray(measurement, dtype=float), np.asarray(observer, dtype=float)[..., :3]
        axes = sight_axes(m[..., 0], m[..., 1])
        e = axes.radial
        p = np.einsum("...i,...i->...", place, e)
        own = np.einsum("...i,...i->...", acceleration(place, self.constants, self.j2), e)
        p, d2, z, ez, turn, k = np.broadcast_arrays(
            p,
            # at least 1 m: a line through the centre of the Earth has no foot
            np.maximum((place * place).sum(axis=-1) - p * p, 1.0),
            place[..., 2],
            e[..., 2],
            np.maximum((m[..., 2] * axes.cosine) ** 2 + m[..., 3] ** 2, _SMALLEST),
            m[..., 5] + own,
        )
        c = self.constants
        bulge = 1.5 * c.mu * c.j2 * c.radius**2 if self.j2 else 0.0
        one = np.index_exp[..., None]
        return _Line(p[one], d2[one], z[one], ez[one], turn[one], k[one], c.mu, bulge)

    def residual(self, distance: Array, measurement: Array, observer: Array) -> Array:
        """Return f(r) [m/s^2] for distances (..., m) [m]."""
        line = self._line(measurement, observer)
        return line.value(distance + line.p)

    def slope(self, distance: Array, measurement: Array, observer: Array) -> Array:
        """Return df/dr [1/s^2] for distances (..., m) [m]; where it vanishes two roots meet and ranging is singular."""
        line = self._line(measurement, observer)
        return line.slope(distance + line.p)

    def ranges(self, measurement: Array, observer: Array) -> Array:
        r"""Return all positive roots.

        Returns
        -------
        ndarray, shape (..., 3)
            Distances [m], increasing; NaN where there is no such root. Since :math:`f(0) = -\ddot r` there are one or
            three where the radial acceleration is positive, none or two where it is negative.

        Notes
        -----
        f' has two zeros, :math:`\pm s_1` for two bodies, where :math:`w_2 < \mu/d^3` (d: from
        the Earth's centre to the line), else none. Between them f is monotone: at most one root in each of three
        intervals. :math:`y = s_1^2/d^2` solves :math:`(1 - 2y)(1 + y)^{-5/2} = w_2 d^3/\mu`, a
        convex and falling function, by Newton's iteration from y = 0. With J2 the zeros of f' are found by halving
        (0, d) and (-d, 0).
        """
        line = self._line(measurement, observer)
        d = np.sqrt(line.d2)
        if line.bulge:
            waves = line.slope(np.zeros_like(d)) < 0
            # from 3e7 m to 2e-6 m: an extremum is flat, and where two roots all but meet neither is worth more
            ends = np.concatenate([-d, 0 * d, d], axis=-1)
            turning = line.halve(True, ends[..., :2], ends[..., 1:], np.array([-1.0, 1.0]), halvings=44)
        else:
            ratio = line.turn * line.d2 * d / line.mu
            waves = ratio < 1
            y = np.zeros_like(ratio)
            for _ in range(9):
                base = 1 + y
                y = np.minimum(y + ((1 - 2 * y) - ratio * base**2.5) * base / (4.5 - 3 * y), 0.5)
            s1 = d * np.sqrt(np.maximum(y, 0.0))
            turning = np.concatenate([-s1, s1], axis=-1)
        first, second = turning[..., :1], turning[..., 1:]
        first, second = np.where(waves, first, line.p), np.where(waves, second, line.p)
        # beyond this the pull of the Earth is smaller than what the rest of f has gained
        away = 1e7
        end = np.maximum(away, (np.abs(line.k) + line.mu / away**2) * 1.1 / line.turn + np.abs(line.p)) + away
        low = np.concatenate([line.p, np.maximum(first, line.p), np.maximum(second, line.p)], axis=-1)
        high = np.concatenate([first, second, end], axis=-1)
        rising = np.array([1.0, -1.0, 1.0])
        with np.errstate(invalid="ignore"):
            inside = (high > low) & (line.value(low) * rising <= 0) & (line.value(high) * rising > 0)
        root = line.halve(False, np.where(inside, low, np.nan), high, rising) - line.p
        return np.where(inside & (root > 0), root, np.nan)

    def naive_range(self, measurement: Array, observer: Array) -> Array:
        """Return the range of a target without acceleration [m], eq. (11) with its cosine corrected; shape (...)."""
        line = self._line(measurement, observer)
        return (line.k / line.turn)[..., 0]

    # ---- how good a root is

    def range_partials(
        self, distance: Array, measurement: Array, observer: Array, axes: SightAxes | None = None
    ) -> Array:
        r"""Return the derivatives of the range with respect to the six rows.

        .. math:: \frac{\partial r}{\partial m} = -\frac{\partial f/\partial m}{\partial f/\partial r}

        Parameters
        ----------
        distance : ndarray, shape (...)
            A root [m].
        measurement, observer : ndarray, shape (..., 6)
        axes : SightAxes, optional
            Of the measurement, where somebody has them already.

        Returns
        -------
        ndarray, shape (..., 6)
            Zero for the radial velocity. For two bodies (29) to (35) of the paper, corrected.
        """
        m = np.asarray(measurement, dtype=float)
        place = np.asarray(observer, dtype=float)[..., :3]
        axes = axes or sight_axes(m[..., 0], m[..., 1])
        target = place + distance[..., None] * axes.radial
        pull = np.einsum("...ij,...j->...i", gradient(target, self.constants, self.j2), axes.radial)
        relative = acceleration(target, self.constants, self.j2) - acceleration(place, self.constants, self.j2)
        sideways = distance[..., None] * pull + relative

        def dot(a: Array, b: Array) -> Array:
            return np.einsum("...i,...i->...", a, b)

        ce, se = axes.cosine, axes.sine
        slope = (m[..., 2] * ce) ** 2 + m[..., 3] ** 2 + dot(pull, axes.radial)
        change = np.zeros((*np.broadcast_shapes(slope.shape, m.shape[:-1]), 6))
        change[..., 0] = ce * dot(sideways, axes.azimuthal)
        change[..., 1] = dot(sideways, axes.elevational) - 2 * distance * m[..., 2] ** 2 * ce * se
        change[..., 2] = 2 * distance * m[..., 2] * ce**2
        change[..., 3] = 2 * distance * m[..., 3]
        change[..., 5] = -1.0
        return -change / slope[..., None]

    def states(self, distance: Array, measurement: Array, observer: Array) -> Array:
        """Return the inertial states of targets at `distance` (...), eq. (24) and (27); shape (..., 6)."""
        m, own = np.asarray(measurement, dtype=float), np.asarray(observer, dtype=float)
        axes = sight_axes(m[..., 0], m[..., 1])
        across = (axes.cosine * m[..., 2])[..., None] * axes.azimuthal + m[..., 3, None] * axes.elevational
        r = distance[..., None]
        return np.concatenate(
            [own[..., :3] + r * axes.radial, own[..., 3:6] + m[..., 4, None] * axes.radial + r * across], axis=-1
        )

    def state_jacobian(self, distance: Array, measurement: Array, observer: Array) -> Array:
        """Return the derivative of `states` at a root with respect to the six rows, shape (..., 6, 6).

        The range moves with every row but the radial velocity: its error is correlated with those of the angles.
        """
        m = np.asarray(measurement, dtype=float)
        axes = sight_axes(m[..., 0], m[..., 1])
        partials = self.range_partials(distance, measurement, observer, axes)
        r, ce, se = distance[..., None], axes.cosine[..., None], axes.sine[..., None]
        turn, lift, speed = m[..., 2, None], m[..., 3, None], m[..., 4, None]
        e_r, e_b, e_e = axes.radial, axes.azimuthal, axes.elevational
        across = ce * turn * e_b + lift * e_e
        jacobian = np.zeros((*partials.shape[:-1], 6, 6))
        jacobian[..., :3, :] = _position_rows(distance, partials, axes)
        jacobian[..., 3:, :] = across[..., :, None] * partials[..., None, :]
        jacobian[..., 3:, 0] += speed * ce * e_b - r * ce * turn * (ce * e_r - se * e_e) - r * lift * se * e_b
        jacobian[..., 3:, 1] += speed * e_e - r * se * turn * e_b - r * lift * e_r
        jacobian[..., 3:, 2] += r * ce * e_b
        jacobian[..., 3:, 3] += r * e_e
        jacobian[..., 3:, 4] += e_r
        return jacobian

    def state_covariance(self, distance: Array, measurement: Array, observer: Array, sigmas: Array) -> Array:
        """Return the covariance of `states` for independent errors with `sigmas` (6,), shape (..., 6, 6)."""
        root = self.state_jacobian(distance, measurement, observer) * sigmas
        return root @ np.swapaxes(root, -1, -2)

    def position_covariance(self, distance: Array, measurement: Array, observer: Array, sigmas: Array) -> Array:
        """Return the covariance of the position, eq. (46) to (49) with the correlation that they leave out."""
        m = np.asarray(measurement, dtype=float)
        axes = sight_axes(m[..., 0], m[..., 1])
        root = _position_rows(distance, self.range_partials(distance, m, observer, axes), axes) * sigmas
        return root @ np.swapaxes(root, -1, -2)

    # ---- which roots can be a satellite

    def possible(self, states: Array, minimum_height: float) -> NDArray[np.bool_]:
        """Return which states (..., 6) are above the Earth's radius plus `minimum_height` [m] and bound."""
        with np.errstate(invalid="ignore"):
            radius = np.sqrt((states[..., :3] ** 2).sum(axis=-1))
            return (radius > self.constants.radius + minimum_height) & (energy(states, self.constants, self.j2) < 0)

    def candidates(self, measurement: Array, observer: Array, minimum_height: float | None) -> tuple[Array, Array]:
        """Return ranges (..., 3) and states (..., 3, 6) of the roots.

        Parameters
        ----------
        measurement, observer : ndarray, shape (..., 6)
        minimum_height : float or None
            Roots lower than this [m], or unbound, are NaN; None: every root counts.
        """
        found = self.ranges(measurement, observer)
        states = self.states(
            found, np.asarray(measurement, dtype=float)[..., None, :], np.asarray(observer, dtype=float)[..., None, :]
        )
        if minimum_height is None:
            return found, states
        good = self.possible(states, minimum_height)
        return np.where(good, found, np.nan), np.where(good[..., None], states, np.nan)


def _position_rows(distance: Array, partials: Array, axes: SightAxes) -> Array:
    """Return the derivative of a target's position with respect to the six rows, shape (..., 3, 6)."""
    r = distance[..., None]
    rows = axes.radial[..., :, None] * partials[..., None, :]
    rows[..., 0] += r * axes.cosine[..., None] * axes.azimuthal
    rows[..., 1] += r * axes.elevational
    return rows
