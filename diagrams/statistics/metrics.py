"""How good the estimates of a study are: errors, RMSE, medians, consistency, convergence, divergence.

Everything is a function of a study's result (`quietfix.diagrams.run_study`), over all trials and epochs at once. Where
the *truth* is NaN the error is NaN: nothing is known there, and the trial is left out at that epoch. Where the
*estimate* is not finite the error is infinite: a lost trial stays in every RMSE and median, and its infinity becomes
null in ``summary.json``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from quietfix.diagrams.quantities.frame import UNITS
from quietfix.diagrams.statistics.consistency import nees_statistics, nis_statistics
from quietfix.diagrams.statistics.epochs import along, by_number
from quietfix.diagrams.statistics.json_numbers import json_numbers
from quietfix.diagrams.statistics.state_errors import BOUNDS, QUANTITIES, errors

__all__ = [
    "armse",
    "causal",
    "convergence_time",
    "diverged",
    "median",
    "not_started",
    "percentile",
    "rmse",
    "summarise",
]


_UNITS = {what: unit.replace("/", "p") for what, unit in UNITS.items()}
_HUGE = 1e150  # stands for infinity while percentiles are interpolated; its square is still finite


# ---------------------------------------------------------------------------------------------- over trials


def rmse(error: xr.DataArray) -> xr.DataArray:
    """Return the root mean square over the trials; infinite if a trial is lost, NaN where no truth is known."""
    known = error.notnull()
    total = (error**2).where(known, 0.0).sum("trial")
    count = known.sum("trial")
    return (total / count.where(count > 0)) ** 0.5


def median(error: xr.DataArray) -> xr.DataArray:
    """Return the median over the trials of the size of the error; lost trials count as infinite."""
    return percentile(error, 50.0)


def percentile(error: xr.DataArray, percent: float) -> xr.DataArray:
    """Return a percentile over the trials of the size of the error.

    Parameters
    ----------
    error : xarray.DataArray
        With the dimension ``trial``; one of `errors`.
    percent : float
        0 to 100.

    Returns
    -------
    xarray.DataArray
        Interpolated between order statistics; infinite where a lost trial takes part, NaN where no truth is known.
    """
    if not 0 <= percent <= 100:
        raise ValueError(f"percent: {percent} is not allowed; 0 to 100")
    size = abs(error).clip(max=_HUGE)  # between two infinities interpolation would give NaN
    axis = error.get_axis_num("trial")
    values = np.full([n for i, n in enumerate(error.shape) if i != axis], np.nan)
    known = np.isfinite(size.values).any(axis=axis)
    if known.any():
        moved = np.moveaxis(size.values, axis, 0)
        values[known] = np.nanpercentile(moved[:, known], percent, axis=0)
    kept = size.isel(trial=0, drop=True)
    return kept.copy(data=np.where(values > 1e-3 * _HUGE, np.inf, values))


# -------------------------------------------------------------------------------------------------- scalars


def armse(curve: ArrayLike) -> float:
    """Return the average over the epochs of an RMSE curve; epochs without a known truth (NaN) are left out."""
    values = np.asarray(curve, dtype=float)
    values = values[~np.isnan(values)]
    return float(values.mean()) if values.size else math.nan


def convergence_time(time: ArrayLike, curve: ArrayLike, threshold: float | None = None, fraction: float = 0.5) -> float:
    """Return the first epoch from which an RMSE curve stays at or below a threshold, to the end.

    Parameters
    ----------
    time : array_like, shape (time,)
        Epochs [s].
    curve : array_like, shape (time,)
        RMSE; infinite where a trial is lost, NaN where there is none (such epochs do not decide).
    threshold : float, optional
        In the unit of the curve. By default `fraction` times the first value of the curve that is finite:
        estimators that start from the same fix are then held to the same threshold, and none's convergence time
        depends on who else takes part.
    fraction : float
        See `threshold`.

    Returns
    -------
    float
        Time [s]; NaN if the curve does not stay below.
    """
    t, values = np.asarray(time, dtype=float), np.asarray(curve, dtype=float)
    known = ~np.isnan(values)
    t, values = t[known], values[known]
    finite = np.isfinite(values)
    if not finite.any():
        return math.nan
    limit = fraction * values[finite][0] if threshold is None else threshold
    above = np.flatnonzero(~(values <= limit))
    first = above[-1] + 1 if above.size else 0
    return float(t[first]) if first < t.size else math.nan


def diverged(dataset: xr.Dataset, limit: float | None = None) -> xr.DataArray:
    """Return which trials have diverged: position error at the last epoch not finite, or beyond the limit.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result.
    limit : float, optional
        Position error [m]; by default the attribute ``divergence_m``.

    Returns
    -------
    xarray.DataArray of bool, dims (estimator, trial)
        The last epoch is the last one at which the trial's truth is known; a trial without any has not diverged.
    """
    return _diverged(errors(dataset)["position"], _limit(dataset, limit))


def causal(dataset: xr.Dataset, estimator: str) -> bool:
    """Return whether an estimator uses no measurement before it is made, as far as a result says it."""
    return "causal" not in dataset.coords or bool(dataset["causal"].sel(estimator=estimator))


def not_started(dataset: xr.Dataset) -> xr.DataArray:
    """Return which trials never started: no epoch has a finite position, although the truth is known at some.

    Returns
    -------
    xarray.DataArray of bool, dims (estimator, trial)
        Such a trial has no error to be counted in an RMSE, as a lost one has: it is counted apart.
    """
    error = errors(dataset)["position"]
    axis = along(error)
    return error.notnull().any(axis) & ~(abs(error) < np.inf).any(axis)


def _limit(dataset: xr.Dataset, limit: float | None) -> float:
    return float(dataset.attrs["divergence_m"] if limit is None else limit)


def _diverged(position: xr.DataArray, limit: float) -> xr.DataArray:
    known = position.notnull()
    axis = along(position)
    last = known.sizes[axis] - 1 - known.isel({axis: slice(None, None, -1)}).argmax(axis)
    return position.isel({axis: last}).drop_vars("time", errors="ignore") > limit


# -------------------------------------------------------------------------------------------------- summary


def summarise(dataset: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Return the part ``estimators`` of ``summary.json``.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result with the attribute ``divergence_m``, with or without bounds.

    Returns
    -------
    dict
        By estimator: lists over the epochs and scalars, as in the design's list; null (None) where a number is
        undefined or not finite. Errors are over the trials that started, also where they diverged later;
        ``not_started`` says how many never did.
    """
    if "estimator" not in dataset.coords:  # nothing is estimated
        return {}
    # One estimator after the other: a study of many trials would not fit into memory five times.
    return {
        str(name): _summarise_one(dataset.isel(estimator=[i])) for i, name in enumerate(dataset["estimator"].values)
    }


def _summarise_one(dataset: xr.Dataset) -> dict[str, Any]:
    tracks = along(dataset) == "epoch"
    dataset = by_number(dataset)
    time = dataset["time"].values
    never = not_started(dataset)
    error = errors(dataset).where(~never)
    curves = {name: rmse(error[name]).values[0] for name in error}
    nees, nis = nees_statistics(dataset), nis_statistics(dataset)
    missing = [None] * time.size

    def curve(name: str) -> list[float | None]:
        return json_numbers(curves[name]) if name in curves else list(missing)

    quantities = [name for name in QUANTITIES if name != "bias" or name in curves]
    summary: dict[str, Any] = {f"rmse_{name}_{_UNITS[name]}": curve(name) for name in quantities}
    summary["median_position_m"] = json_numbers(median(error["position"]).values[0])
    summary["nees_mean"] = json_numbers(nees["mean"].values[0])
    summary["nis_mean"] = json_numbers(nis["mean"].values[0])
    summary["nis_dof_mean"] = json_numbers(nis["dof_mean"].values[0])
    for name in (bound for bound in BOUNDS if bound.rpartition("_")[2] in quantities):
        values = dataset[name].values[0] if name in dataset else np.full(time.size, np.nan)
        summary[f"{name}_{_UNITS[name.rpartition('_')[2]]}"] = json_numbers(values)
    name = str(dataset["estimator"].values[0])
    summary["causal"] = causal(dataset, name)
    summary["not_started"] = int(never.sum())
    summary["diverged"] = int(_diverged(error["position"], _limit(dataset, None)).sum())
    summary["armse_position_m"] = json_numbers(armse(curves["position"]))
    converged = convergence_time(time, curves["position"], dataset.attrs.get("convergence_m"))
    # tracks have no time in common
    summary["convergence_time_s"] = None if tracks else json_numbers(converged)
    return summary
