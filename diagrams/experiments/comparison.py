"""What a comparison says of its estimators, with intervals over the trials: RMSE, efficiency, NEES, and who is best."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import binomtest

from quietfix.diagrams.experiments.candidates import Lineup
from quietfix.diagrams.experiments.compared_study import ComparedStudy
from quietfix.diagrams.experiments.summary_entries import interval_entry, machine, nearest_epoch, nees_entry, run_entry
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.bootstrap import Interval, OneTrial, PairedBootstrap, Replicates, best_of, interval
from quietfix.diagrams.statistics.epochs import from_the_end
from quietfix.diagrams.statistics.json_numbers import json_numbers
from quietfix.diagrams.statistics.lost import recovery_entry, recovery_lines
from quietfix.diagrams.statistics.metrics import causal, diverged, median, not_started
from quietfix.diagrams.statistics.state_errors import errors
from quietfix.diagrams.studies.starting import why_not_started

__all__ = ["check_at", "comparison_statistics"]

Array = NDArray[np.float64]

_FINER = 16  # times as many resamples where they do not decide who is best


def comparison_statistics(
    dataset: xr.Dataset,
    study: ComparedStudy,
    chosen: Lineup,
    at: float | None = None,
    confidence: float = 0.95,
    resamples: int = 9999,
    costs: Mapping[str, float] | None = None,
) -> dict[str, Any]:
    """Return the comparison of a study's estimators.

    Parameters
    ----------
    dataset : xarray.Dataset
        The study's result.
    study : ComparedStudy
        For costs and sizes.
    chosen : Lineup
        For what was left out.
    at, confidence
        See `compare`.
    resamples : int
        Of the bootstrap.
    costs : mapping of str to float, optional
        Processor time of one step of one trial [us] by estimator, where other processes have run it.

    Returns
    -------
    dict
        Numbers as ``{"value", "low", "high"}`` where they have an interval, None where undefined or not finite.
        ``time_s``: None where they are taken at the end of each track of a recording. ``estimators.NAME``:
        ``rmse_position_m`` (at the time), ``armse_position_m`` (mean over time of the RMSE),
        ``median_position_m``, ``bound_position_m``, ``efficiency`` (RMSE over bound) and whether it ``is`` one
        (``efficiency_means_something``: the truth moves as the filter believes), ``nees_per_state`` with
        ``nees_band`` and ``nees_verdict``, ``diverged``, ``not_started`` (in no RMSE; in ``best``
        infinite where another one started), ``cost_us``. ``best.METRIC``: who has the smallest, whether significantly,
        the runner-up, and the ratio of every other one to it.
    """
    if not 0 < confidence < 1:
        raise UserError(f"confidence: {confidence} is not allowed; between 0 and 1")
    check_at(study, at)
    if not dataset["truth"].notnull().any():
        raise UserError(f"compare: {study.found.title} is not allowed; nobody knows where its target was")
    dataset = from_the_end(dataset)
    times = np.asarray(dataset["time"].values, dtype=float)
    epoch = nearest_epoch(times, at)
    draws = OneTrial() if dataset.sizes["trial"] == 1 else PairedBootstrap(dataset.sizes["trial"], resamples)
    spent = study.costs if costs is None else costs
    rows, replicates, squared = _rows(dataset, study, spent, draws, epoch, confidence)
    best = _Best(rows, replicates, squared, draws, epoch, confidence)
    return {
        **run_entry(dataset),
        "machine": machine(),
        # tracks have no time in common, but each has an end
        "time_s": None if study.of_tracks else float(times[epoch]),
        "confidence": confidence,
        "resamples": resamples,
        "correction": "Bonferroni over the comparisons of the best with all others",
        "batch": min(study.chunk, draws.trials),
        "feedback": study.feedback,
        "note": dataset.attrs.get("note", ""),
        "not_started": why_not_started(dataset, {name: row["not_started"] for name, row in rows.items()}),
        "recovery": recovery_lines(rows, draws.trials),
        "left_out": dict(chosen.left_out),
        "lighter": {name: dict(options) for name, options in chosen.lighter.items()},
        "estimators": rows,
        "best": {metric: best.of(column) for column, metric in enumerate(("rmse_position_m", "armse_position_m"))},
    }


def check_at(study: ComparedStudy, at: float | None) -> None:
    """Refuse a time that a study does not have.

    Raises
    ------
    UserError
        Saying which there are.
    """
    if at is None:
        return
    if study.of_tracks:
        raise UserError(
            f"at: {at:g} is not allowed for {study.found.title}; its tracks have no time in common, and are compared "
            "at their ends"
        )
    ticks = study.model.clock.ticks(study.model.duration)
    if not ticks[0] <= at <= ticks[-1]:
        raise UserError(f"at: {at:g} is not allowed; {study.found.title} runs from {ticks[0]:g} to {ticks[-1]:g} s")


def _rows(
    dataset: xr.Dataset,
    study: ComparedStudy,
    costs: Mapping[str, float],
    draws: PairedBootstrap,
    epoch: int,
    confidence: float,
) -> tuple[dict[str, dict[str, Any]], list[Replicates], list[Array]]:
    """Return what is said of every estimator, and the errors that they compete by.

    These are RMSE at the epoch and its mean over time, resampled, and the squares (trials, time) that they are made of.
    """
    never = not_started(dataset)
    nobody = never.all("estimator").values
    rows: dict[str, dict[str, Any]] = {}
    replicates: list[Replicates] = []
    squared: list[Array] = []
    for name in [str(name) for name in dataset["estimator"].values]:
        one, out = dataset.sel(estimator=[name]), never.sel(estimator=name).values
        error = errors(one)["position"].where(~never.sel(estimator=[name]))
        squares = np.square(error.values[0])
        # Who does not start where another does is not the better for it: there its error is infinite.
        alone = (out & ~nobody)[:, None]
        found = _resampled(squares, draws, epoch)
        squared.append(np.where(alone, np.inf, squares))
        replicates.append(_resampled(squared[-1], draws, epoch) if alone.any() else found)
        row: dict[str, Any] = {"causal": causal(dataset, name)}
        row |= _errors_entry(one, error, interval(found, confidence), epoch)
        lost_now = np.isinf(error.values[0, :, epoch])
        row |= nees_entry(one["nees"].values[0, :, epoch], lost_now, study.states[name], draws, confidence)
        row |= _trials_entry(one, out, confidence)
        rows[name] = row | {"cost_us": json_numbers(costs[name])}
    return rows, replicates, squared


def _resampled(squares: Array, draws: PairedBootstrap, epoch: int) -> Replicates:
    """Return RMSE at an epoch and its mean over time, of squared errors (trials, time)."""
    return draws.apply(squares, lambda means: _rmse_and_mean(means, epoch))


def _errors_entry(one: xr.Dataset, error: xr.DataArray, both: Interval, epoch: int) -> dict[str, Any]:
    """Return RMSE at the epoch and over time, median, bound and efficiency of one estimator."""
    return {
        "rmse_position_m": interval_entry(both, 0),
        "armse_position_m": interval_entry(both, 1),
        "median_position_m": json_numbers(median(error).values[0, epoch]),
        **_efficiency(one, Interval(*(part[0] for part in both)), epoch),
    }


def _trials_entry(one: xr.Dataset, out: NDArray[np.bool_], confidence: float) -> dict[str, Any]:
    """Return how many trials of one estimator did not start (`out`), and how many of the others diverged."""
    lost = int((diverged(one).values[0] & ~out).sum())
    tail = binomtest(lost, out.size).proportion_ci(confidence, "exact")
    return {
        "not_started": int(out.sum()),
        "diverged": lost,
        "diverged_rate": {"low": float(tail.low), "high": float(tail.high)},
        **recovery_entry([one]),
    }


def _rmse_and_mean(means: Array, epoch: int) -> Array:
    """Return RMSE at an epoch and its mean over time from mean squares (..., time)."""
    curve = np.sqrt(means)
    known = ~np.isnan(curve)
    with np.errstate(invalid="ignore"):
        average = np.where(known, curve, 0.0).sum(axis=-1) / known.sum(axis=-1)
    return np.stack([curve[..., epoch], average], axis=-1)


class _Best:
    """Who has the smallest of a metric; only who works with the past can be it."""

    def __init__(
        self,
        rows: Mapping[str, Mapping[str, Any]],
        replicates: Sequence[Replicates],
        squared: Sequence[Array],
        draws: PairedBootstrap,
        epoch: int,
        confidence: float,
    ) -> None:
        causal_ones = [i for i, row in enumerate(rows.values()) if row["causal"]]
        self._names = [list(rows)[i] for i in causal_ones]
        self._replicates = [replicates[i] for i in causal_ones]
        self._squared = [squared[i] for i in causal_ones]
        self._draws, self._epoch, self._confidence = draws, epoch, confidence

    def _finer(self) -> list[Replicates]:
        if isinstance(self._draws, OneTrial):
            return list(self._replicates)
        draws = dataclasses.replace(self._draws, resamples=_FINER * self._draws.resamples)
        return [_resampled(one, draws, self._epoch) for one in self._squared]

    def of(self, column: int) -> dict[str, Any] | None:
        """Return name, significance, runner-up and ratios of a metric; None where there is nobody."""
        names = self._names
        if not names:
            return None

        def joined(parts: Sequence[Replicates]) -> Replicates:
            return Replicates(*(np.stack([p[..., column] for p in same], axis=-1) for same in zip(*parts, strict=True)))

        found = joined(self._replicates)
        best, ratios, significant = best_of(found, self._confidence, lambda: joined(self._finer()))
        ratio = {name: interval_entry(ratios, i) for i, name in enumerate(names) if i != best}
        order = np.argsort(np.where(np.isnan(found.value), np.inf, found.value), kind="stable")
        runner_up = next((names[i] for i in order if i != best), None)
        return {"name": names[best], "significant": significant, "runner_up": runner_up, "ratio": ratio}


def _efficiency(one: xr.Dataset, rmse: Interval, epoch: int) -> dict[str, Any]:
    """Return bound, RMSE over bound, and whether that is an efficiency."""
    empty = np.full(one.sizes["time"], np.nan)
    bound, of_truth = (
        one[name].values[0] if name in one else empty for name in ("bound_position", "bound_truth_position")
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = Interval(*(part / bound[epoch] for part in rmse))
    return {
        "bound_position_m": json_numbers(bound[epoch]),
        "efficiency": interval_entry(ratio),
        # the two bounds differ by the process noise only
        "efficiency_means_something": bool(np.isfinite(bound[epoch]) and np.allclose(bound, of_truth, rtol=1e-6)),
    }
