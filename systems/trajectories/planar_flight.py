"""A flight in a vertical plane from a record of its speed and altitude."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import cumulative_simpson
from scipy.interpolate import BSpline, CubicHermiteSpline, CubicSpline, make_lsq_spline
from scipy.optimize import least_squares

__all__ = ["PlanarFlight", "check_record", "fit_planar_flight"]

Array = NDArray[np.float64]

_STEP = 0.05  # s, of the quadrature of height and angle


@dataclass(frozen=True, eq=False)
class PlanarFlight:
    """Speed, path angle, height and angle round the Earth as smooth functions between events; see `fit_planar_flight`.

    Attributes
    ----------
    radius : float
        Of the spherical Earth [m].
    breaks : tuple of float
        Where pieces begin and the last one ends [s].
    speed : tuple of BSpline
        Earth-relative speed [m/s] of each piece.
    path_angle : CubicSpline
        Of the velocity above the local horizontal [rad].
    height, angle : tuple of CubicHermiteSpline
        Height [m] and angle round the Earth from the site [rad] of each piece.
    residual_speed, residual_height : float
        Root mean square of record minus smooth curve [m/s], [m].
    """

    radius: float
    breaks: tuple[float, ...]
    speed: tuple[BSpline, ...]
    path_angle: CubicSpline
    height: tuple[CubicHermiteSpline, ...]
    angle: tuple[CubicHermiteSpline, ...]
    residual_speed: float
    residual_height: float

    def at(self, time: float) -> tuple[Array, Array]:
        """Return the state (6,) and acceleration (3,) in the launch frame, X down-range, Y up; NaN off the record."""
        if not self.breaks[0] <= time <= self.breaks[-1]:
            return np.full(6, np.nan), np.full(3, np.nan)
        i = min(int(np.searchsorted(self.breaks, time, side="right")) - 1, len(self.speed) - 1)
        h, theta = float(self.height[i](time)), float(self.angle[i](time))
        v, dv = float(self.speed[i](time)), float(self.speed[i](time, 1))
        gamma, dgamma = float(self.path_angle(time)), float(self.path_angle(time, 1))
        dtheta = v * np.cos(gamma) / (self.radius + h)
        out = np.array([np.sin(theta), np.cos(theta), 0.0])
        ahead = np.array([np.cos(theta), -np.sin(theta), 0.0])
        along = np.sin(gamma) * out + np.cos(gamma) * ahead
        across = np.cos(gamma) * out - np.sin(gamma) * ahead
        position = (self.radius + h) * out - np.array([0.0, self.radius, 0.0])
        return np.concatenate([position, v * along]), dv * along + v * (dgamma - dtheta) * across


def check_record(times: ArrayLike, speed: ArrayLike, altitude: ArrayLike, largest_gap: float) -> tuple[Array, ...]:
    """Return a record as arrays, or raise ValueError: NaN, times that do not increase, gaps, wrong lengths."""
    t, v, h = (np.asarray(x, dtype=float) for x in (times, speed, altitude))
    if t.ndim != 1 or not t.shape == v.shape == h.shape or t.size < 100:
        raise ValueError(f"telemetry: {t.shape}, {v.shape}, {h.shape} samples; at least 100 of each are needed")
    if not all(np.all(np.isfinite(x)) for x in (t, v, h)):
        raise ValueError("telemetry: all numbers must be finite")
    steps = np.diff(t)
    if np.any(steps <= 0):
        raise ValueError(
            f"telemetry: times must increase strictly, but {t[np.argmax(steps <= 0)]:g} s is followed by less"
        )
    if steps.max() > largest_gap:
        at = int(np.argmax(steps))
        raise ValueError(
            f"telemetry: the gap from {t[at]:g} to {t[at + 1]:g} s is not allowed; the longest may be {largest_gap:g} s"
        )
    return t, v, h


def fit_planar_flight(
    times: ArrayLike,
    speed: ArrayLike,
    altitude: ArrayLike,
    jumps: Sequence[float],
    radius: float,
    smoothing: float,
    angle_knots: float = 20.0,
    largest_gap: float = 2.0,
    search: float = 0.0,
) -> PlanarFlight:
    r"""Fit speed and path angle to a record, so that height is the integral of v sin(gamma).

    Parameters
    ----------
    times, speed, altitude : array_like, shape (samples,)
        [s], Earth-relative [m/s], [m]; rounded to whatever the record shows.
    jumps : sequence of float
        When the acceleration jumps [s] (cut-off, ignition): the speed may bend there.
    radius : float
        Of the spherical Earth [m].
    smoothing : float
        Distance of the knots of the speed [s].
    angle_knots : float
        Distance of the knots of the path angle [s].
    largest_gap : float
        A record with a longer gap is refused [s].
    search : float
        The jumps are known to so many seconds only; each is moved to where the record bends most, unless the record
        has a gap there.

    Returns
    -------
    PlanarFlight

    Raises
    ------
    ValueError
        For a record that cannot be used.

    Notes
    -----
    The speed is a cubic least-squares spline, piece by piece but continuous at the jumps. The path angle, 90 deg at
    lift-off, is a cubic spline whose knots are found by nonlinear least squares on the recorded altitude: the recorded
    altitude is never differentiated, which its rounding to 1 km would not survive.
    """
    t, v, h = check_record(times, speed, altitude, largest_gap)
    breaks = (float(t[0]), *(_sharpened(t, v, float(j), search) for j in jumps if t[0] < j < t[-1]), float(t[-1]))
    knots: list[Array] = []
    for a, b in pairwise(breaks):
        count = max(1, round((b - a) / smoothing))
        knots.append(np.linspace(a, b, count + 1)[:-1])
    # A threefold knot lets the cubic bend at a jump; a knot without samples behind it would have no say.
    inside = [np.concatenate([np.full(3, k[0]) if i else [], k[1:]]) for i, k in enumerate(knots)]
    interior = np.concatenate(inside)
    supported = np.array([np.any(np.abs(t - k) <= smoothing) or k in breaks for k in interior], dtype=bool)
    interior = interior[supported]
    full = np.concatenate([np.full(4, breaks[0]), interior, np.full(4, breaks[-1])])
    whole = make_lsq_spline(t, v, full, k=3)
    pieces = tuple(_piece(whole, a, b) for a, b in pairwise(breaks))

    count = max(4, round((t[-1] - t[0]) / angle_knots))
    places = np.linspace(t[0], t[-1], count + 1)
    # One angle per second is enough for the fit; Simpson's rule on that grid is good to metres.
    grid = np.arange(t[0], t[-1] + 0.5, 0.5)
    grid[-1] = t[-1]
    smooth_speed = np.maximum(whole(grid), 0.0)
    recorded = np.interp(grid, t, h)
    start = recorded[0]

    def program(free: Array) -> CubicSpline:
        return CubicSpline(places, np.concatenate([[np.pi / 2], free]))

    def misfit(free: Array) -> Array:
        climb = smooth_speed * np.sin(program(free)(grid))
        model = start + cumulative_simpson(climb, x=grid, initial=0.0)
        bend = 100.0 * np.diff(np.concatenate([[np.pi / 2], free]), 2)
        return np.concatenate([(model - recorded) / 300.0, bend])

    guess = np.arcsin(np.clip(np.gradient(np.interp(places, t, h), places) / np.maximum(whole(places), 50.0), -1, 1))
    found = least_squares(misfit, guess[1:], x_scale="jac")
    angle = program(found.x)
    heights, angles = _integrate(pieces, angle, breaks, start, radius)
    flight = PlanarFlight(radius, breaks, pieces, angle, heights, angles, float(np.std(v - whole(t))), 0.0)
    modelled = np.array([np.hypot(*_polar(flight, float(s))) - radius for s in grid])
    residual = float(np.sqrt(np.mean((recorded - modelled) ** 2)))
    return PlanarFlight(radius, breaks, pieces, angle, heights, angles, flight.residual_speed, residual)


def _polar(flight: PlanarFlight, time: float) -> tuple[float, float]:
    position = flight.at(time)[0]
    return float(position[0]), float(position[1] + flight.radius)


def _piece(whole: BSpline, begin: float, end: float) -> BSpline:
    """Return the spline between two breaks as one of its own: at a break it then has the derivative of its side."""
    inside = whole.t[(whole.t > begin) & (whole.t < end)]
    knots = np.concatenate([np.full(4, begin), inside, np.full(4, end)])
    # Four sites in every knot interval determine the cubic there: the fit is exact.
    ends = np.unique(knots)
    sites = np.unique(np.concatenate([np.linspace(a, b, 5) for a, b in pairwise(ends)]))
    return make_lsq_spline(sites, whole(sites), knots, k=3)


def _sharpened(t: Array, v: Array, jump: float, search: float) -> float:
    """Return the instant near `jump` at which two parabolas that meet fit the speed best."""
    near = np.abs(t - jump) <= search + 5.0
    x, y = t[near], v[near]
    candidates = np.arange(jump - search, jump + search + 0.025, 0.05)
    if search <= 0 or np.diff(np.clip(x, jump - search, jump + search)).max(initial=0.0) > 1.0:
        return jump  # the record has a gap there: nothing better is known
    misfits = []
    for c in candidates:
        after = np.maximum(x - c, 0.0)
        basis = np.stack([np.ones_like(x), x - c, (x - c) ** 2, after, after**2], axis=1)
        misfits.append(np.sum((y - basis @ np.linalg.lstsq(basis, y, rcond=None)[0]) ** 2))
    return float(candidates[int(np.argmin(misfits))])


def _integrate(
    pieces: Sequence[BSpline], angle: CubicSpline, breaks: Sequence[float], start: float, radius: float
) -> tuple[tuple[CubicHermiteSpline, ...], tuple[CubicHermiteSpline, ...]]:
    heights, angles = [], []
    height, theta = start, 0.0
    for piece, (a, b) in zip(pieces, pairwise(breaks), strict=True):
        grid = np.linspace(a, b, max(3, round((b - a) / _STEP) + 1))
        speed, gamma = piece(grid), angle(grid)
        climb = speed * np.sin(gamma)
        h = height + cumulative_simpson(climb, x=grid, initial=0.0)
        turn = speed * np.cos(gamma) / (radius + h)
        round_ = theta + cumulative_simpson(turn, x=grid, initial=0.0)
        heights.append(CubicHermiteSpline(grid, h, climb))
        angles.append(CubicHermiteSpline(grid, round_, turn))
        height, theta = float(h[-1]), float(round_[-1])
    return tuple(heights), tuple(angles)
