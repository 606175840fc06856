"""How the errors of two results differ, with intervals over the trials: paired where they share their noise."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import binomtest

from quietfix.diagrams.commands.results.trials import Ends
from quietfix.diagrams.statistics.bootstrap import Interval, PairedBootstrap, Replicates, interval
from quietfix.diagrams.statistics.json_numbers import json_numbers

__all__ = ["MANY", "compared"]

Array = NDArray[np.float64]

MANY = 4096
"""Trials from which intervals are those of the normal distribution: a bootstrap of so many is the same, and slow."""
_NAMES = ("rmse_a_m", "rmse_b_m", "ratio", "nees_a", "nees_b", "nees_difference")


def compared(a: Ends, b: Ends, paired: bool, confidence: float) -> dict[str, Any]:
    """Return what is told of one estimator in two results.

    Parameters
    ----------
    a, b : Ends
        How its trials end; the same trials in the same order if they are paired.
    paired : bool
    confidence : float
        Of every interval, each for itself.

    Returns
    -------
    dict
        ``rmse_a_m``, ``rmse_b_m``, ``ratio`` (of the RMSE of b to that of a), ``nees_a``, ``nees_b`` (per component)
        and ``nees_difference`` (b - a) as ``{"value", "low", "high"}``; ``median_a_m``, ``median_b_m``; ``b_closer``,
        if they are paired: the share of the trials in which b has the smaller error, of those that differ, with its
        exact interval; ``identical``: whether all errors are equal to the last bit. Errors are of trials that started;
        paired: in both.
    """
    started_a, started_b = ~a.never & ~np.isnan(a.error), ~b.never & ~np.isnan(b.error)
    if paired:
        started_a = started_b = started_a & started_b
    first, second = _columns(a, started_a), _columns(b, started_b)
    found = _normal(first, second, paired, confidence)
    if min(len(first), len(second)) >= 2 and max(len(first), len(second)) <= MANY:
        found = _bootstrapped(first, second, paired, confidence)
    told: dict[str, Any] = {
        name: {part: json_numbers(values[i]) for part, values in found._asdict().items()}
        for i, name in enumerate(_NAMES)
    }
    told |= {"median_a_m": json_numbers(a.median), "median_b_m": json_numbers(b.median)}
    told |= {"trials_a": len(first), "trials_b": len(second)}
    told |= {f"diverged_{which}": int(one.lost.sum()) for which, one in (("a", a), ("b", b))}
    told |= {f"not_started_{which}": int(one.never.sum()) for which, one in (("a", a), ("b", b))}
    if paired:
        told["identical"] = bool(np.array_equal(a.error, b.error, equal_nan=True) and (a.never == b.never).all())
        told["b_closer"] = _closer(first[:, 0], second[:, 0], confidence)
    return told


def _columns(ends: Ends, started: NDArray[np.bool_]) -> Array:
    """Return squared error and NEES (trials, 2); the NEES of a lost trial is infinite."""
    nees = np.where(ends.lost & np.isnan(ends.nees), np.inf, ends.nees)
    return np.stack([np.square(ends.error), nees], axis=-1)[started]


def _statistics(means: Array) -> Array:
    """Return RMSE of both, logarithm of their ratio, NEES of both, and its difference, from means (..., 4)."""
    square_a, nees_a, square_b, nees_b = np.moveaxis(means, -1, 0)
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = 0.5 * (np.log(square_b) - np.log(square_a))
        return np.stack([np.sqrt(square_a), np.sqrt(square_b), ratio, nees_a, nees_b, nees_b - nees_a], axis=-1)


def _bootstrapped(first: Array, second: Array, paired: bool, confidence: float) -> Interval:
    if paired:
        found = PairedBootstrap(len(first)).apply(np.concatenate([first, second], axis=-1), _statistics)
    else:
        found = _independent(first, second)
    limits = interval(found, confidence)
    return _with_ratio(limits)


def _independent(first: Array, second: Array) -> Replicates:
    """Return replicates of two samples that have nothing in common: each is drawn again for itself."""
    one = PairedBootstrap(len(first), seed=0).apply(first, lambda means: means)
    other = PairedBootstrap(len(second), seed=1).apply(second, lambda means: means)

    def both(a: Array, b: Array) -> Array:
        a, b = np.broadcast_arrays(a, b)
        return _statistics(np.concatenate([a, b], axis=-1))

    # the jackknife of two samples leaves out a trial of one or of the other
    left_out = np.concatenate([both(one.left_out, other.value), both(one.value, other.left_out)])
    return Replicates(both(one.value, other.value), both(one.resampled, other.resampled), left_out)


def _normal(first: Array, second: Array, paired: bool, confidence: float) -> Interval:
    r"""Return intervals of the normal distribution by the delta method, of a ratio and of an RMSE on the logarithm.

    The influence of a trial on :math:`\tfrac12\log(\bar b/\bar a)` is :math:`\tfrac12(b/\bar b-a/\bar a)` (Efron and
    Tibshirani, *An Introduction to the Bootstrap*, 1993, section 21.3).
    """
    reach = float(ndtri((1 + confidence) / 2))
    with np.errstate(invalid="ignore", divide="ignore"):
        means = np.concatenate([_mean(first), _mean(second)])
        value = _statistics(means)
        of_a, of_b = 0.5 * first[:, 0] / means[0], 0.5 * second[:, 0] / means[2]
        if paired:
            spreads = (_error(of_b - of_a), _error(second[:, 1] - first[:, 1]))
        else:
            spreads = (
                math.hypot(_error(of_a), _error(of_b)),
                math.hypot(_error(first[:, 1]), _error(second[:, 1])),
            )
        logarithm = np.array([_error(of_a), _error(of_b), 0.0, 0.0, 0.0, 0.0])
        plain = np.array([0.0, 0.0, spreads[0], _error(first[:, 1]), _error(second[:, 1]), spreads[1]])
        factor = np.exp(reach * logarithm)
        return _with_ratio(Interval(value, value / factor - reach * plain, value * factor + reach * plain))


def _with_ratio(limits: Interval) -> Interval:
    """Return the ratio in the place of its logarithm."""
    ratio = np.arange(len(_NAMES)) == _NAMES.index("ratio")
    with np.errstate(over="ignore"):
        return Interval(*(np.where(ratio, np.exp(part), part) for part in limits))


def _mean(columns: Array) -> Array:
    known = ~np.isnan(columns)
    count = known.sum(axis=0)
    return np.asarray(np.where(known, columns, 0.0).sum(axis=0) / np.where(count > 0, count, np.nan))


def _error(values: Array) -> float:
    """Return the standard error of a mean; NaN where it has none."""
    known = values[~np.isnan(values)]
    return float(known.std(ddof=1) / math.sqrt(known.size)) if known.size > 1 else math.nan


def _closer(first: Array, second: Array, confidence: float) -> dict[str, Any] | None:
    """Return in which share of the trials the second error is the smaller one; None where none differ."""
    fewer, differ = int((second < first).sum()), int((second != first).sum())
    if not differ:
        return None
    limits = binomtest(fewer, differ).proportion_ci(confidence, "exact")
    return {"value": fewer / differ, "low": float(limits.low), "high": float(limits.high), "trials": differ}
