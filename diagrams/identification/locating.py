"""Where a station is that heard a known satellite: from the Doppler of one pass or several."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as f_distribution

from quietfix.diagrams.identification.blocks import MUCH, Blocks, blocks_of, gain_of_more, smooth_part, system_of
from quietfix.diagrams.identification.candidates import Heard, Orbit, orbit_of, passes_of, time_sigma
from quietfix.diagrams.identification.fit import Fit, correlation_time, fitted, own_scale
from quietfix.diagrams.identification.prediction import satellite_path
from quietfix.diagrams.identification.priors import Priors
from quietfix.diagrams.identification.rows import used_rows
from quietfix.diagrams.readers.doppler.elements import Elements
from quietfix.diagrams.readers.doppler.received import Received
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import ecef_to_geodetic, enu_rotation, geodetic_to_ecef

__all__ = ["Located", "Place", "locate"]

Array = NDArray[np.float64]

_CHI_99 = 9.2103  # squared radius of a 99 % ellipse of two dimensions: -2 ln 0.01
_ELEMENTS = 1e3  # m that elements are off across and above the track: the place is as much off

_ALONG = 25  # trial places along the track
_ACROSS = np.array([0.5, 1.5, 3.0, 5.0, 7.5, 10.0, 13.0, 17.0, 21.0])  # and across it [deg of the Earth]
_BEYOND = 0.4  # of a pass before its first and after its last row
_STARTS = 3  # on each side
_STEPS = 25
_LONGEST = 200e3  # m that a step may be
_CLOSE = 1.0  # m
_DIFFERENCE = 200.0  # m
_FLAT = 1e7  # m: what is known of the place before
_CORNERS = 8  # of the ellipse where the likelihood is looked at
_BENT = 2.0  # times as much or as little as an ellipse says
_FARTHEST = 300e3  # m, half the long axis
_OTHER = 1e-4  # probability of the other side of the track: the true one of a real pass had 8e-4
_SYSTEMATIC = 2.5  # residual over what a smooth curve leaves of it
_TOGETHER = 6.0  # blocks that count as one


@dataclass(frozen=True, eq=False)
class Place:
    """A place that explains the rows.

    Attributes
    ----------
    latitude, longitude, height : float
        [deg], [deg], [m]
    covariance : ndarray, shape (2, 2)
        Of east and north [m^2].
    radius : float
        Squared radius of the 99 % ellipse of that covariance.
    fit : Fit
        Parameters: oscillators, along-track time, east, north, up from the place.
    ahead : float
        How far the satellite is ahead of its elements [s].
    probability : float
        Against the best place on the other side of the track.
    bent : float
        How many times as much, or as little, the likelihood falls at the 99 % ellipse as it would of a Gaussian.
    """

    latitude: float
    longitude: float
    height: float
    covariance: Array
    radius: float
    fit: Fit
    ahead: float
    probability: float = 1.0
    bent: float = 1.0

    @property
    def axes(self) -> tuple[float, float, float]:
        """Half axes of the 99 % ellipse [m], and the direction of the longer one, clockwise from north [deg]."""
        values, vectors = np.linalg.eigh(self.covariance)
        east, north = vectors[:, 1]
        short, long = np.sqrt(self.radius * np.maximum(values, 0.0))
        return float(long), float(short), float(np.degrees(np.arctan2(east, north)) % 180.0)


@dataclass(frozen=True, eq=False)
class Located:
    """What came out.

    Attributes
    ----------
    places : list of Place
        The best one first; the second, if any, is on the other side of the track.
    elements : Elements
    used : ndarray of bool, shape (rows,)
    scale, together, systematic : float
        As in `quietfix.diagrams.identification.ranking.Ranking`.
    prior_time : float
        What was believed of the time that the satellite is ahead of its elements [s].
    more : float
        Logarithm of the likelihood that one more state of the oscillator would gain.
    notes : list of str
    """

    places: list[Place]
    elements: Elements
    used: NDArray[np.bool_]
    scale: float
    together: float
    systematic: float
    prior_time: float
    more: float
    notes: list[str]

    @property
    def doubts(self) -> list[str]:
        """Why the ellipse of the best place is not to be trusted; empty: it is."""
        best, found = self.places[0], []
        if self.systematic > _SYSTEMATIC:
            found.append(f"what is left is no noise: {self.systematic:.1f} times what a smooth curve leaves of it")
        if self.together > _TOGETHER:
            found.append(f"what is left hangs together: {self.together:.0f} of 100 blocks count as one")
        if len(self.places) > 1 and self.places[1].probability > _OTHER:
            found.append(f"the other side of the track has probability {self.places[1].probability:.2g}")
        if self.more > MUCH:
            found.append(f"an oscillator with one more state is {np.exp(min(self.more, 99)):.2g} times as likely")
        if best.axes[0] > _FARTHEST:
            found.append(f"the ellipse is {best.axes[0] / 1e3:.0f} km long to one side")
        if not 1 / _BENT < best.bent < _BENT:
            found.append(f"it is no ellipse: at its edge the likelihood falls {best.bent:.1f} times as much as of one")
        if abs(best.ahead) > 4 * self.prior_time:
            found.append(f"the satellite would be {best.ahead:+.1f} s ahead of its elements")
        return found


@dataclass(frozen=True, eq=False)
class _Problem:
    """What all trial places share."""

    received: Received
    elements: Elements
    measured: Array
    blocks: Blocks
    prior: Array
    height: float

    @property
    def fitted(self) -> int:
        """How many parameters the rows determine: the oscillators', east, north, and the time or the height."""
        return self.prior.size - 1

    def system(self, place: Array, ahead: float) -> tuple[Array, Array]:
        """Return design and values of a place (latitude, longitude [rad], height [m]), linearised there.

        Raises
        ------
        UserError
            If SGP4 fails.
        """
        ecef = geodetic_to_ecef(*place)
        turn = enu_rotation(place[0], place[1])
        orbit = _orbit(self.elements, self.received, ahead)
        rate, slope, _ = orbit.all_at(ecef)
        moved = [
            (orbit.rates(ecef + _DIFFERENCE * axis) - orbit.rates(ecef - _DIFFERENCE * axis)) / (2 * _DIFFERENCE)
            for axis in turn
        ]
        columns = np.concatenate([slope[:, None], np.stack(moved, axis=1)], axis=1)
        return system_of(self.blocks, self.measured, rate, columns)

    def center(self, place: Array, ahead: float) -> Array:
        """Return the prior's mean of the parameters, which count from there."""
        center = np.zeros_like(self.prior)
        center[-4], center[-1] = -ahead, self.height - place[2]
        return center


def _orbit(elements: Elements, received: Received, ahead: float) -> Orbit:
    found = orbit_of(elements, received, ahead)
    if found is None:
        raise UserError(f"--tle: SGP4 cannot tell where {elements.label} is then")
    return found


def locate(received: Received, elements: Elements, height: float, sigma_height: float, priors: Priors) -> Located:
    """Find a station from what it heard of a satellite that is known.

    Trial places on a grid along and across the ground track tell which rows are of the satellite; from the best ones
    on each side, Gauss-Newton steps of robust least squares (see `quietfix.diagrams.identification.fit`) in the
    oscillators, the time that the satellite is ahead of its elements, and the place, whose height is known to
    `sigma_height`. The oscillators have a state more than is asked for: what one pass takes for a shift of the place
    may be that (on real passes of a free-running oscillator, ellipses without it missed the station by up to three
    times their size; the limits of the doubts were set while looking at such passes).

    Parameters
    ----------
    received : Received
    elements : Elements
    height, sigma_height : float
        Above the ellipsoid [m].
    priors : Priors

    Raises
    ------
    UserError
        If SGP4 fails or too few rows are left.
    """
    priors = replace(priors, order=priors.order + 1)
    measured = -SPEED_OF_LIGHT * received.frequency / received.carrier
    trials, sides = _trials(received, elements, height)
    orbit = _orbit(elements, received, 0.0)
    tables = [orbit.all_at(geodetic_to_ecef(*place)) for place in trials]
    objects = [Heard(elements, 0.0, rate, slope, float(np.degrees(up.max()))) for rate, slope, up in tables]
    used, notes = used_rows(received, measured, objects)
    blocks = blocks_of(received, used, priors.order)
    age = (received.second + received.rest - elements.epoch) / 86400.0
    time = time_sigma(age) if priors.time is None else priors.time
    prior = np.concatenate([blocks.priors(priors), [time, _FLAT, _FLAT, sigma_height]])
    problem = _Problem(received, elements, measured, blocks, prior, height)
    systems = (system_of(blocks, measured, one.range_rate, one.slope[:, None]) for one in objects)
    scales = np.array([own_scale(*system, prior[:-3], 0 * prior[:-3]) for system in systems])
    starts = [k for side in (-1, 1) for k in np.argsort(np.where(sides == side, scales, np.inf))[:_STARTS]]
    scale, together = float(scales.min()), 1.0
    found = [_settled(problem, trials[k], 0.0, scale, 1.0) for k in starts]
    for _ in range(2):  # the scale and correlation at the best place are known only when it is
        best = max(found, key=lambda one: one[2].likelihood)
        design, value = problem.system(best[0], best[1])
        scale = own_scale(design, value, prior, problem.center(best[0], best[1]))
        together = correlation_time(best[2].residual)
        found = [_settled(problem, place, ahead, scale, together) for place, ahead, _ in found]
    places = _places(problem, found, scale, together)
    first = max(found, key=lambda one: one[2].likelihood)
    there, center = problem.system(first[0], first[1]), problem.center(first[0], first[1])
    more = gain_of_more(received, used, there, prior, center, priors, (scale, together))
    return Located(places, elements, used, scale, together, smooth_part(places[0].fit.residual), time, more, notes)


def _trials(received: Received, elements: Elements, height: float) -> tuple[list[Array], NDArray[np.int64]]:
    """Return trial places (latitude, longitude [rad], height [m]) and on which side of the track each is."""
    number = passes_of(received.times)
    longest = np.argmax(np.bincount(number))
    mine = received.times[number == longest]
    span = mine[-1] - mine[0]
    times = np.linspace(mine[0] - _BEYOND * span, mine[-1] + _BEYOND * span, _ALONG)
    states = satellite_path(elements.satellite, received.second, received.rest, times)
    if states is None:
        raise UserError(f"--tle: SGP4 cannot tell where {elements.label} is then")
    places, sides = [], []
    for state in states:
        below = state[:3] / np.linalg.norm(state[:3])
        normal = np.cross(state[:3], state[3:])
        normal /= np.linalg.norm(normal)
        for side in (-1, 1):
            for angle in np.radians(_ACROSS) * side:
                point = 6.371e6 * (np.cos(angle) * below + np.sin(angle) * normal)
                latitude, longitude, _ = (float(one) for one in ecef_to_geodetic(point))
                places.append(np.array([latitude, longitude, height]))
                sides.append(side)
    return places, np.array(sides)


Settled = tuple[Array, float, Fit]


def _settled(problem: _Problem, place: Array, ahead: float, scale: float, together: float) -> Settled:
    """Return the most likely place from a start on, the time ahead there, and the fit."""
    place, fit = place.copy(), None
    for _ in range(_STEPS):
        fit = fitted(*problem.system(place, ahead), problem.prior, problem.center(place, ahead), scale, together)
        step = fit.estimate[-3:].copy()
        length = float(np.linalg.norm(step[:2]))
        step *= min(1.0, _LONGEST / max(length, 1e-9))
        moved = geodetic_to_ecef(*place) + enu_rotation(place[0], place[1]).T @ np.array([step[0], step[1], 0.0])
        latitude, longitude, _ = (float(one) for one in ecef_to_geodetic(moved))
        place = np.array([latitude, longitude, place[2] + step[2]])
        ahead += float(np.clip(fit.estimate[-4], -30.0, 30.0))
        if length < _CLOSE:
            break
    fit = fitted(*problem.system(place, ahead), problem.prior, problem.center(place, ahead), scale, together)
    return place, ahead, fit


def _places(problem: _Problem, found: list[Settled], scale: float, together: float) -> list[Place]:
    """Return the best place and, if there is one, the best that is another one."""
    found = sorted(found, key=lambda one: -one[2].likelihood)
    first = _place(problem, found[0], scale, together)
    reach = first.axes[0] + 20e3
    here = geodetic_to_ecef(*found[0][0])
    others = [one for one in found[1:] if np.linalg.norm(geodetic_to_ecef(*one[0]) - here) > reach]
    if not others:
        return [first]
    second = _place(problem, others[0], scale, together)
    odds = float(np.exp(min(others[0][2].likelihood - found[0][2].likelihood, 0.0)))
    shares = 1 / (1 + odds), odds / (1 + odds)
    return [
        Place(one.latitude, one.longitude, one.height, one.covariance, one.radius, one.fit, one.ahead, share, one.bent)
        for one, share in zip((first, second), shares, strict=True)
    ]


def _freedom(problem: _Problem, together: float) -> float:
    """Return degrees of freedom: independent blocks less what is fitted to them, at least one."""
    return max(len(problem.blocks.parts) / together - problem.fitted, 1.0)


def _place(problem: _Problem, found: Settled, scale: float, together: float) -> Place:
    place, ahead, fit = found
    covariance = fit.covariance[-3:-1, -3:-1]
    bent = _bent(problem, found, covariance, scale, together)
    freedom = _freedom(problem, together)
    wider = covariance * (freedom + problem.fitted) / freedom + _ELEMENTS**2 * np.eye(2)
    covariance, radius = wider, 2 * float(f_distribution.ppf(0.99, 2, freedom))
    return Place(
        float(np.degrees(place[0])),
        float(np.degrees(place[1])),
        float(place[2]),
        covariance,
        radius,
        fit,
        ahead,
        bent=bent,
    )


def _bent(problem: _Problem, found: Settled, covariance: Array, scale: float, together: float) -> float:
    """Return by how much the likelihood on the 99 % ellipse is off that of a Gaussian, at the worst of its corners.

    All other parameters are fitted anew there, so that it is the profile likelihood: half of 9.21 below the best.
    """
    place, ahead, fit = found
    root = np.linalg.cholesky(covariance + 1e-6 * np.eye(2))
    turn = enu_rotation(place[0], place[1])
    here = geodetic_to_ecef(*place)
    held = problem.prior.copy()
    held[-3:-1] = 1e-3
    worst = 1.0
    for angle in 2 * np.pi * np.arange(_CORNERS) / _CORNERS:
        east, north = np.sqrt(_CHI_99) * root @ np.array([np.cos(angle), np.sin(angle)])
        latitude, longitude, _ = (float(x) for x in ecef_to_geodetic(here + turn.T @ np.array([east, north, 0.0])))
        corner = np.array([latitude, longitude, place[2]])
        there = ahead
        for _ in range(2):
            at = fitted(*problem.system(corner, there), held, problem.center(corner, there), scale, together)
            there += float(np.clip(at.estimate[-4], -30.0, 30.0))
        ratio = (fit.peak - at.peak) / (0.5 * _CHI_99)
        if abs(np.log(max(ratio, 1e-3))) > abs(np.log(worst)):
            worst = max(ratio, 1e-3)
    return worst
