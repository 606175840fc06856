"""Looks at a growing number of trials, and the verdict.

The looks are paid for: what may go wrong in all, 1 - confidence, is divided by the number of planned looks
(Bonferroni), so that neither *holds* nor *fails* is reported more often than that where the truth is exactly at the
limit, whenever the trials happen to be stopped. Jennison and Turnbull, *Group Sequential Methods*, 2000, has sharper
boundaries; they need increments that are nearly Gaussian, which mean squares of a hundred trials are not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.diagrams.statistics.intervals import Statistic

__all__ = ["FAILS", "HOLDS", "UNDECIDED", "WORDS", "Judgement", "Limit", "judge", "plan_looks"]

Array = NDArray[np.float64]

HOLDS, FAILS, UNDECIDED = 1, -1, 0
WORDS = {HOLDS: "holds", FAILS: "fails", UNDECIDED: "undecided"}


def plan_looks(trials: int, trial_limit: int, looks: int) -> tuple[int, ...]:
    """Return at how many trials the requirements are looked at: from `trials` to `trial_limit` in equal ratios.

    Fewer looks than asked for if there are not so many different numbers of trials.
    """
    if trial_limit <= trials:
        return (trial_limit,)
    if looks == 1:
        return (trial_limit,)
    steps = np.round(np.geomspace(trials, trial_limit, looks)).astype(int)
    return tuple(int(n) for n in np.unique(steps))


@dataclass(frozen=True)
class Limit:
    """What a metric may be; at least one of the two.

    Attributes
    ----------
    at_least, at_most : float or None
        Both allowed themselves.
    """

    at_least: float | None = None
    at_most: float | None = None

    def tail(self, confidence: float, looks: int) -> float:
        """Return the share that each confidence limit may miss, at each look.

        A band can fail on two sides, so that each gets half of it.
        """
        both = self.at_least is not None and self.at_most is not None
        return (1 - confidence) / looks / (2 if both else 1)

    def decide(self, lower: ArrayLike, upper: ArrayLike) -> NDArray[np.int_]:
        """Return which of `HOLDS`, `FAILS`, `UNDECIDED` follows from an interval."""
        low, high = np.asarray(lower), np.asarray(upper)
        least = -np.inf if self.at_least is None else self.at_least
        most = np.inf if self.at_most is None else self.at_most
        fails = (low > most) | (high < least)
        holds = (low >= least) & (high <= most)
        return np.where(fails, FAILS, np.where(holds, HOLDS, UNDECIDED))


@dataclass(frozen=True)
class Judgement:
    """What came out; arrays over the leading axes of the samples.

    Attributes
    ----------
    verdict : ndarray of int
        `HOLDS`, `FAILS` or `UNDECIDED`.
    trials : ndarray of int
        How many were used.
    estimate, lower, upper : ndarray
        At the look that decided, or the last one.
    """

    verdict: NDArray[np.int_]
    trials: NDArray[np.int_]
    estimate: Array
    lower: Array
    upper: Array

    def replaced(self, later: Judgement) -> Judgement:
        """Return this where it is a decision, `later` where it is none."""
        undecided = self.verdict == UNDECIDED
        pairs = {field.name: (getattr(later, field.name), getattr(self, field.name)) for field in fields(self)}
        return Judgement(**{name: np.where(undecided, new, old) for name, (new, old) in pairs.items()})


def judge(
    samples: Callable[[int], Array], statistic: Statistic, limit: Limit, confidence: float, looks: tuple[int, ...]
) -> Judgement:
    """Look until all is decided or the planned looks are used up; the first decision stands.

    Parameters
    ----------
    samples : callable
        ``samples(n)`` are those of the first n trials, (..., n, columns); fewer where some have none.
    statistic : Statistic
        What is estimated.
    limit : Limit
        What it may be.
    confidence : float
        The probability of a wrong verdict is at most 1 - confidence.
    looks : tuple of int
        From `plan_looks`.
    """
    tail = limit.tail(confidence, len(looks))
    found: Judgement | None = None
    for n in looks:
        values = samples(n)
        outer = values.shape[:-2]
        estimate = statistic.estimate(values) if values.shape[-2] else np.full(outer, np.nan)
        lower, upper = np.full(outer, -np.inf), np.full(outer, np.inf)
        if values.shape[-2] >= max(2, statistic.floor):
            lower, upper = statistic.interval(values, tail)
        verdict = limit.decide(lower, upper)
        now = Judgement(verdict, np.full(verdict.shape, n), estimate, lower, upper)
        found = now if found is None else found.replaced(now)
        if np.all(found.verdict != UNDECIDED):
            break
    assert found is not None
    return found
