"""Which object explains received frequencies best, and whether the others can be ruled out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.identification.blocks import Blocks, blocks_of, gain_of_more, smooth_part, system_of
from quietfix.diagrams.identification.candidates import Heard, heard, predicted, time_sigma
from quietfix.diagrams.identification.fit import Fit, correlation_time, fitted, own_scale
from quietfix.diagrams.identification.priors import Priors
from quietfix.diagrams.identification.rows import used_rows
from quietfix.diagrams.readers.doppler.elements import Elements
from quietfix.diagrams.readers.doppler.received import Received
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.constants import SPEED_OF_LIGHT

__all__ = ["Ranked", "Ranking", "rank"]

Array = NDArray[np.float64]

_REFINED = 4  # times that the orbit is looked up at the time that was found
_CLOSE = 0.02  # s
_FAR = 15.0  # scales of the best object: others are not refined
_LINEAR = 30.0  # s along the orbit
_CERTAIN = 0.95
_SYSTEMATIC = 3.0  # residual over what a smooth curve leaves of it
_ELEMENTS = 30.0  # m/s that elements may leave of a range rate


@dataclass(frozen=True, eq=False)
class Ranked:
    """An object and how well it explains the rows.

    Attributes
    ----------
    heard : Heard
    rms : float
        Of the residuals of all used rows [m/s].
    oscillator, oscillator_sigma : ndarray, shape (passes, order)
        Bias [m/s] in the middle of each pass, drift [m/s^2] and drift rate [m/s^3].
    ahead, ahead_sigma : float
        How far it is ahead of its elements [s].
    prior_time : float
        What was believed of that [s].
    likelihood : float
        Logarithm, against the best one: 0 or less.
    probability : float
        If it is one of the objects of the file, each as likely before.
    residual : ndarray, shape (rows,)
        Of all used rows [m/s].
    """

    heard: Heard
    rms: float
    oscillator: Array
    oscillator_sigma: Array
    ahead: float
    ahead_sigma: float
    prior_time: float
    likelihood: float
    probability: float
    residual: Array


@dataclass(frozen=True, eq=False)
class Ranking:
    """What came out.

    Attributes
    ----------
    ranked : list of Ranked
        The best one first.
    used : ndarray of bool, shape (rows,)
        Which rows were used.
    scale : float
        Of a block's median [m/s].
    noise : float
        Robust standard deviation of a single row about the best object [m/s].
    together : float
        Blocks that say the same as one.
    systematic : float
        Residual of the best object over what a smooth curve leaves of it; 1: noise only.
    more : float
        Logarithm of the likelihood that one more state of the oscillator would gain.
    notes : list of str
    """

    ranked: list[Ranked]
    used: NDArray[np.bool_]
    scale: float
    noise: float
    together: float
    systematic: float
    more: float
    notes: list[str] = field(default_factory=list)

    @property
    def explained(self) -> bool:
        """Whether the best object leaves no more than elements may leave, and is where they say."""
        best = self.ranked[0]
        smooth = self.systematic < _SYSTEMATIC or self.scale < _ELEMENTS
        return smooth and abs(best.ahead) < 4 * best.prior_time

    @property
    def rivals(self) -> list[Ranked]:
        """Objects that cannot be told from the best one."""
        first = self.ranked[0].probability
        return [one for one in self.ranked[1:] if one.probability > (1 - _CERTAIN) * first]

    @property
    def identified(self) -> bool:
        """Whether it is one object: explained, and with a probability of 0.95 at least."""
        return self.explained and self.ranked[0].probability >= _CERTAIN


def rank(received: Received, elements: Sequence[Elements], station: Array, priors: Priors) -> Ranking:
    r"""Rank the objects of a file by how well they explain received frequencies.

    Range rates :math:`c(1 - f/f_0)` less those predicted are :math:`b + d t + s\,\delta` and noise: an oscillator per
    pass, and the time :math:`\delta` that the object is ahead of its elements, with s from SGP4. Medians of about a
    hundred blocks per pass follow a t distribution of one scale for all objects, that of the best one; neighbours that
    say the same count as one.

    Parameters
    ----------
    received : Received
    elements : sequence of Elements
    station : ndarray, shape (3,)
        Earth-fixed [m].
    priors : Priors

    Raises
    ------
    UserError
        If no object is over the horizon, or too few rows are left.
    """
    objects, notes = heard(elements, received, station)
    if not objects:
        raise UserError(
            f"--tle: none of {len(elements)} objects is over the station's horizon then; is the date right?"
        )
    measured = -SPEED_OF_LIGHT * received.frequency / received.carrier
    used, said = used_rows(received, measured, objects)
    blocks = blocks_of(received, used, priors.order)
    priors_of = [_prior(one, priors, blocks) for one in objects]
    scales = np.array(
        [
            own_scale(*system_of(blocks, measured, one.range_rate, one.slope[:, None]), prior, 0 * prior)
            for one, prior in zip(objects, priors_of, strict=True)
        ]
    )
    near = [k for k in np.argsort(scales) if scales[k] <= _FAR * scales.min()]
    scale, together = float(scales.min()), 1.0
    fits = [_refined(objects[k], received, station, blocks, measured, priors_of[k], scale, 1.0) for k in near]
    for _ in range(2):  # the scale and correlation of the best one are known only when it is
        best = max(range(len(fits)), key=lambda i: fits[i][0].likelihood)
        scale, together = _noise(blocks, measured, fits[best], priors_of[near[best]])
        fits = [_refined(objects[k], received, station, blocks, measured, priors_of[k], scale, together) for k in near]
    notes += said
    if len(near) < len(objects):
        notes.append(
            f"{len(objects) - len(near)} of {len(objects)} objects over the horizon are far off and not ranked"
        )
    return _ranking(objects, near, fits, blocks, measured, priors, (scale, together), (received, used), notes)


def _prior(one: Heard, priors: Priors, blocks: Blocks) -> Array:
    time = time_sigma(one.age) if priors.time is None else priors.time
    return np.append(blocks.priors(priors), time)


Refined = tuple[Fit, float, Array, Array]


def _refined(
    one: Heard,
    received: Received,
    station: Array,
    blocks: Blocks,
    measured: Array,
    prior: Array,
    scale: float,
    together: float,
) -> Refined:
    """Return the fit, the time ahead it is linearised at, and range rates and slopes there."""
    ahead, rate, slope = 0.0, one.range_rate, one.slope
    center = np.zeros_like(prior)
    for _ in range(_REFINED):
        center[-1] = -ahead
        fit = fitted(*system_of(blocks, measured, rate, slope[:, None]), prior, center, scale, together)
        step = float(np.clip(fit.estimate[-1], -_LINEAR, _LINEAR))
        if abs(step) < _CLOSE:
            break
        moved = predicted(one.elements, received, station, ahead + step)
        if moved is None:
            break
        ahead, rate, slope = ahead + step, moved[0], moved[1]
    center[-1] = -ahead
    fit = fitted(*system_of(blocks, measured, rate, slope[:, None]), prior, center, scale, together)
    return fit, ahead, rate, slope


def _noise(blocks: Blocks, measured: Array, found: Refined, prior: Array) -> tuple[float, float]:
    """Return scale and correlation of the residuals of an object."""
    fit, ahead, rate, slope = found
    center = np.append(np.zeros(prior.size - 1), -ahead)
    return own_scale(*system_of(blocks, measured, rate, slope[:, None]), prior, center), correlation_time(fit.residual)


def _ranking(
    objects: Sequence[Heard],
    near: Sequence[int],
    fits: Sequence[Refined],
    blocks: Blocks,
    measured: Array,
    priors: Priors,
    noise: tuple[float, float],
    heard_in: tuple[Received, NDArray[np.bool_]],
    notes: list[str],
) -> Ranking:
    top = max(fit.likelihood for fit, *_ in fits)
    odds = np.exp([fit.likelihood - top for fit, *_ in fits])
    ranked = []
    rows = np.concatenate(blocks.parts)
    for k, (fit, ahead, rate, slope), odd in zip(near, fits, odds, strict=True):
        rest = (measured - rate - blocks.basis @ fit.estimate[:-1] - slope * fit.estimate[-1])[rows]
        ranked.append(
            Ranked(
                objects[k],
                float(np.sqrt(np.mean(rest**2))),
                fit.estimate[:-1].reshape(-1, priors.order),
                fit.sigma[:-1].reshape(-1, priors.order),
                ahead + float(fit.estimate[-1]),
                float(fit.sigma[-1]),
                float(_prior(objects[k], priors, blocks)[-1]),
                fit.likelihood - top,
                float(odd / odds.sum()),
                rest,
            )
        )
    ranked.sort(key=lambda one: -one.likelihood)
    best, ahead, rate, slope = max(fits, key=lambda found: found[0].likelihood)
    prior = _prior(ranked[0].heard, priors, blocks)
    center = np.append(np.zeros(prior.size - 1), -ahead)
    there = system_of(blocks, measured, rate, slope[:, None])
    more = gain_of_more(*heard_in, there, prior, center, priors, noise)
    about = float(1.4826 * np.median(np.abs(ranked[0].residual)))
    return Ranking(ranked, heard_in[1], noise[0], about, noise[1], smooth_part(best.residual), more, notes)
