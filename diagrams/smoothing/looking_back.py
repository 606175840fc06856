"""Smoothed estimates in the place of those that a filter had when the run went on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.build import Assembly
from quietfix.diagrams.quantities.states import block, columns, shared
from quietfix.diagrams.statistics.score import normalised_error
from quietfix.systems.clocks import Clock
from quietfix.systems.estimators.base import Estimator

__all__ = ["look_back"]

Array = NDArray[np.float64]
Log = tuple[Array, dict[str, Array]]


def look_back(wired: Assembly, logs: Sequence[Log], clock: Clock | None = None) -> list[Log]:
    """Return the logs of a run with the estimates, covariances and NEES of smoothers as they are when it is over.

    Parameters
    ----------
    wired : Assembly
        The diagram.
    logs : sequence of (times, signals)
        Signals (time, trials or 1, size); the last has all epochs, and what `Assembly.course` says.
    clock : Clock, optional
        Of a track: whose ticks are its own.

    Returns
    -------
    list of (times, signals)
    """
    smoothed = {name: one for name, one in wired.estimators.items() if one.smoother is not None}
    if not smoothed:
        return list(logs)
    times, course = logs[-1]
    own = np.arange(times.size) if clock is None else _ticks(times, clock)
    seen = [(at, dict(signals)) for at, signals in logs]
    for name, estimator in smoothed.items():
        found = _smoothed(wired, name, estimator, times, course, own)
        for at, signals in seen:
            kept = np.isin(times, at)
            signals |= {key: value[kept] for key, value in found.items() if key in signals}
    return list(seen)


def _ticks(times: Array, clock: Clock) -> NDArray[np.intp]:
    return np.flatnonzero([clock.index(float(time)) is not None for time in times])


def _counts(name: str) -> list[str]:
    return [f"{name}/{port}" for port in ("releases", "restarts")]


def _anew(counts: Sequence[Array]) -> NDArray[np.bool_] | None:
    """Return at which epochs (time, trials) one of some counts (time, trials, 1) has grown."""
    grown = [np.diff(count[..., 0], axis=0, prepend=count[:1, :, 0]) > 0 for count in counts]
    return np.logical_or.reduce(grown) if grown else None


def _smoothed(
    wired: Assembly,
    name: str,
    estimator: Estimator,
    times: Array,
    course: Mapping[str, Array],
    own: NDArray[np.intp],
) -> dict[str, Array]:
    """Return estimates, covariances and NEES of one smoother, as they stand in a log."""
    assert estimator.smoother is not None
    whole = f"{name}/whole" in course  # the target and the biases behind it
    ports = ("whole", "whole_covariance") if whole else ("estimate", "covariance")
    mean, flat = (course[f"{name}/{port}"].copy() for port in ports)
    square = flat.reshape(*mean.shape, mean.shape[-1])
    anew = _anew([course[key][own] for key in _counts(name) if key in course])
    mean[own], square[own] = estimator.smoother.smooth(times[own], mean[own], square[own], anew)
    names = estimator.motion.reported.names
    if whole:
        n = len(names)
        mean, square = mean[..., :n], square[..., :n, :n]
        flat = square.reshape(*mean.shape[:-1], n * n)
    both = shared(names, wired.truth_names)
    here, there = columns(names, both), columns(wired.truth_names, both)
    nees = np.full((*mean.shape[:2], 1), np.nan)
    if both:
        error = mean[..., here] - course["truth"][..., there]
        nees[..., 0] = normalised_error(error, block(square, here))
    return {f"{name}/estimate": mean, f"{name}/covariance": flat, f"{name}/nees": nees}
