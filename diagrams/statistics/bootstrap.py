"""The paired bootstrap over trials: how far an RMSE, or a ratio of two, could be off by chance.

A resample draws whole trials, the same ones for every estimator and every epoch, so that what the estimators have in
common (one stream of measurements) stays in common. Every statistic here is a function of means over the trials, so a
resample is a row of how often each trial was drawn, and all resamples of all columns are one matrix product.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

__all__ = [
    "Interval",
    "OneTrial",
    "PairedBootstrap",
    "Replicates",
    "best_of",
    "certainly_positive",
    "interval",
    "log_ratio",
]

Array = NDArray[np.float64]

_DOUBT = 4.0  # standard errors of the resampling: one seed in 30 000 is further off
_ROWS, _NUMBERS = 1000, 2_000_000  # most resamples at once, and most numbers in them


class Interval(NamedTuple):
    """A value with its confidence interval; each a float or an array."""

    value: Array
    low: Array
    high: Array


class Replicates(NamedTuple):
    """A statistic as it is, in every resample, and without each trial.

    Attributes
    ----------
    value : ndarray, shape (...)
    resampled : ndarray, shape (resamples, ...)
    left_out : ndarray, shape (trials, ...)
        The jackknife: the statistic of all trials but one.
    """

    value: Array
    resampled: Array
    left_out: Array


@dataclass(frozen=True)
class PairedBootstrap:
    """Resamples of trials, the same for everything that is asked of it.

    Parameters
    ----------
    trials : int
        How many trials there are, at least 2.
    resamples : int
        How often they are drawn again.
    seed : int
        Of the drawing; nothing to do with the noise of a study.
    """

    trials: int
    resamples: int = 9999
    seed: int = 0

    def __post_init__(self) -> None:
        """Check the arguments."""
        if self.trials < 2:
            raise ValueError(f"trials: {self.trials} is not allowed; an interval over trials needs at least 2")
        if self.resamples < 1:
            raise ValueError(f"resamples: {self.resamples} is not allowed; a whole number >= 1")

    def counts(self) -> Iterator[Array]:
        """Yield blocks (resamples of the block, trials): how often each trial is drawn."""
        random = np.random.default_rng(self.seed)
        rows = max(1, min(_ROWS, _NUMBERS // self.trials))
        for done in range(0, self.resamples, rows):
            some = min(rows, self.resamples - done)
            drawn = random.integers(0, self.trials, (some, self.trials))
            drawn += self.trials * np.arange(some)[:, None]
            yield np.bincount(drawn.ravel(), minlength=some * self.trials).reshape(some, self.trials).astype(float)

    def apply(self, samples: Array, function: Callable[[Array], Array]) -> Replicates:
        """Return a function of the means over the trials.

        Parameters
        ----------
        samples : ndarray, shape (trials, columns)
            NaN where nothing is known: left out of that column's mean. Infinity where a trial is lost: it makes every
            mean infinite that it takes part in.
        function : callable
            From means (..., columns) to the statistic (..., k).

        Returns
        -------
        Replicates
            With shapes (k,), (resamples, k), (trials, k).
        """
        if samples.shape[0] != self.trials:
            raise ValueError(f"samples of {samples.shape[0]} trials; {self.trials} are expected")
        known, lost = ~np.isnan(samples), np.isinf(samples)
        values = np.where(known & ~lost, samples, 0.0)
        complete, whole = bool(known.all()), not lost.any()

        def means(weights: Array) -> Array:
            size = weights.sum(axis=-1, keepdims=True) if complete else weights @ known.astype(float)
            with np.errstate(invalid="ignore", divide="ignore"):
                mean = weights @ values / size
            return mean if whole else np.where(weights @ lost.astype(float) > 0, np.inf, mean)

        everybody = np.ones((1, self.trials))
        resampled = np.concatenate([function(means(block)) for block in self.counts()])
        left_out = np.concatenate(
            [
                function(means(1.0 - np.eye(self.trials)[i : i + 256]))  # blocks: the square would not fit for many
                for i in range(0, self.trials, 256)
            ]
        )
        return Replicates(function(means(everybody))[0], resampled, left_out)


class OneTrial(PairedBootstrap):
    """The same of a single trial, of which nobody knows how far chance moves it: no interval is finite."""

    def __init__(self) -> None:
        super().__init__(1)

    def __post_init__(self) -> None:
        """Allow what the class refuses."""

    def apply(self, samples: Array, function: Callable[[Array], Array]) -> Replicates:
        """See `PairedBootstrap.apply`; resamples and jackknife are NaN."""
        value = function(samples[:1])[0]
        unknown = np.full((1, *value.shape), np.nan)
        return Replicates(value, unknown, unknown)


def interval(found: Replicates, confidence: float = 0.95) -> Interval:
    r"""Return the bias-corrected and accelerated interval.

    Efron and Tibshirani, *An Introduction to the Bootstrap*, 1993, eq. (14.9)-(14.15); `scipy.stats.bootstrap` with
    ``method="BCa"`` for one column. An RMSE is skewed; the plain percentile interval lies too low.

    Parameters
    ----------
    found : Replicates
    confidence : float
        Between 0 and 1.

    Returns
    -------
    Interval
        Order statistics of the resamples, so infinite ones do no harm (the plain percentiles then); (-inf, inf) where
        the value is NaN.
    """
    if not 0 < confidence < 1:
        raise ValueError(f"confidence: {confidence} is not allowed; between 0 and 1")
    value, resampled = found.value, found.resampled
    count = resampled.shape[0]
    shift, acceleration = _correction(found)
    ordered = np.sort(np.where(np.isnan(resampled), np.inf, resampled), axis=0)
    ends = []
    for tail in ((1 - confidence) / 2, (1 + confidence) / 2):
        level = ndtr(_corrected(shift, acceleration, tail))
        rank = np.floor((count + 1) * level) if tail < 0.5 else np.ceil((count + 1) * level)
        index = np.clip(rank.astype(int) - 1, 0, count - 1)
        ends.append(np.take_along_axis(ordered, np.asarray(index)[None], axis=0)[0])
    undefined = np.isnan(value)
    return Interval(value, np.where(undefined, -np.inf, ends[0]), np.where(undefined, np.inf, ends[1]))


def _correction(found: Replicates) -> tuple[Array, Array]:
    """Return bias correction and acceleration of each statistic."""
    value, resampled = found.value, found.resampled
    count = resampled.shape[0]
    with np.errstate(invalid="ignore", divide="ignore"):
        below = ((resampled < value).sum(axis=0) + 0.5 * (resampled == value).sum(axis=0)) / count
        shift = np.where(np.isfinite(value), ndtri(np.clip(below, 0.5 / count, 1 - 0.5 / count)), 0.0)
        lever = found.left_out.mean(axis=0) - found.left_out
        acceleration = (lever**3).sum(axis=0) / (6 * (lever**2).sum(axis=0) ** 1.5)
    return shift, np.where(np.isfinite(acceleration), acceleration, 0.0)  # all alike, or a lost trial


def _corrected(shift: Array, acceleration: Array, tail: float) -> Array:
    """Return the standard normal quantile of the resamples at which the limit of a tail lies."""
    z = shift + ndtri(tail)
    return np.asarray(shift + z / (1 - acceleration * z))


def certainly_positive(found: Replicates, tail: float) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    r"""Return of each statistic whether its lower limit is above zero for certain, and whether that is undecided.

    The lower limit of `interval` is above zero where fewer resamples lie at or below zero than the corrected tail
    allows. The share of B resamples has the standard error :math:`\sqrt{p(1-p)/B}`; the bias correction has
    :math:`\sqrt{\pi/2B}`, and moves the tail's normal quantile about twice as far. Within 4 of both another seed could
    turn the answer: it is undecided, and not certain.
    """
    count = found.resampled.shape[0]
    shift, acceleration = _correction(found)
    wanted = _corrected(shift, acceleration, tail)
    reach = _DOUBT * (1 + 1 / np.square(1 - acceleration * (shift + ndtri(tail)))) * math.sqrt(math.pi / (2 * count))
    least, most = ndtr(wanted - reach), ndtr(wanted + reach)
    share = (~(found.resampled > 0)).sum(axis=0) / count
    above = share < least - _DOUBT * np.sqrt(least * (1 - least) / count)
    below = share > most + _DOUBT * np.sqrt(most * (1 - most) / count)
    defined = ~np.isnan(found.value)
    return above & defined, ~(above | below) & defined


def log_ratio(above: Replicates, below: Replicates) -> Replicates:
    """Return the logarithm of a ratio of two statistics of the same resamples; infinity over infinity is NaN."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return Replicates(*(np.log(a) - np.log(b) for a, b in zip(above, below, strict=True)))


def best_of(
    found: Replicates, confidence: float = 0.95, finer: Callable[[], Replicates] | None = None
) -> tuple[int, Interval, bool]:
    r"""Return which of several statistics is the smallest, by what ratio the others exceed it, and whether that counts.

    Parameters
    ----------
    found : Replicates
        Of K >= 1 positive statistics, shapes (K,), (resamples, K), (trials, K).
    confidence : float
        Of the whole statement.
    finer : callable, optional
        Returns the same statistics with more resamples; called where those of `found` do not decide.

    Returns
    -------
    best : int
        The smallest; NaN counts as infinite.
    ratios : Interval
        Of every statistic over the best, each (K,), at the level :math:`1-\alpha/(K-1)`.
    significant : bool
        Whether every other one's interval lies above 1 by more than the resampling's own error, see
        `certainly_positive`; false where there is no other.

    Notes
    -----
    Bonferroni over the K - 1 comparisons with the best. To be marked, a statistic that is not the smallest would have
    to beat the one that is at the level :math:`\alpha/2(K-1)`; there are K - 1 of them, so a wrong mark has at most
    the probability :math:`\alpha/2` (:math:`\alpha` where two are exactly equal), although the best was chosen by
    looking at the data.
    """
    size = found.value.shape[0]
    best = int(np.argmin(np.where(np.isnan(found.value), np.inf, found.value)))
    reference = Replicates(*(part[..., best, None] for part in found))
    level = 1 - (1 - confidence) / max(1, size - 1)
    ratio = log_ratio(found, reference)
    above, undecided = certainly_positive(ratio, (1 - level) / 2)
    others = np.arange(size) != best
    if finer is not None and np.any(undecided[others]) and np.all((above | undecided)[others]):
        return best_of(finer(), confidence)
    ratios = Interval(*(np.exp(part) for part in interval(ratio, level)))
    return best, ratios, bool(size > 1 and np.isfinite(found.value[best]) and np.all(above[others]))
