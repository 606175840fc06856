"""How good the estimates of a study are: errors, RMSE, medians, consistency, convergence, divergence.

Everything is a function of a study's result (`quietfix.diagrams.run_study`), over all trials and epochs. Where
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
from quietfix.diagrams.statistics.epochs import along, from_the_end
from quietfix.diagrams.statistics.json_numbers import json_numbers
from quietfix.diagrams.statistics.lost import diverged, not_started, recovery_entry
from quietfix.diagrams.statistics.quantiles import median, percentile
from quietfix.diagrams.statistics.state_errors import BOUNDS, QUANTITIES
from quietfix.diagrams.statistics.tally import Ensemble, blocks

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


# ---------------------------------------------------------------------------------------------- over trials


def rmse(error: xr.DataArray) -> xr.DataArray:
    """Return the root mean square over the trials; infinite if a trial is lost, NaN where no truth is known."""
    known = error.notnull()
    total = (error**2).where(known, 0.0).sum("trial")
    count = known.sum("trial")
    return (total / count.where(count > 0)) ** 0.5


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


def causal(dataset: xr.Dataset, estimator: str) -> bool:
    """Return whether an estimator uses no measurement before it is made, as far as a result says it."""
    return "causal" not in dataset.coords or bool(dataset["causal"].sel(estimator=estimator))


# -------------------------------------------------------------------------------------------------- summary


def summarise(dataset: xr.Dataset, ensemble: Ensemble | None = None) -> dict[str, dict[str, Any]]:
    """Return the part ``estimators`` of ``summary.json``.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result with the attribute ``divergence_m``, with or without bounds. Of one on disk no more than a
        chunk is read at once.
    ensemble : Ensemble, optional
        What is known of its trials already.

    Returns
    -------
    dict
        By estimator: lists over the epochs and scalars, as in the design's list; null (None) where a number is
        undefined or not finite. Errors are over the trials that started, also where they diverged later;
        ``not_started`` says how many never did.
    """
    if "estimator" not in dataset.coords:  # nothing is estimated
        return {}
    tracks = along(dataset) == "epoch"
    known = ensemble or Ensemble(dataset)
    nees, nis = nees_statistics(known.dataset, sums=known.sums), nis_statistics(known.dataset, sums=known.sums)
    numbers = xr.merge([nees[["mean"]].rename(mean="nees"), nis[["mean", "dof_mean"]]])
    biases = _biases(dataset)
    return {
        str(name): _summarise_one(known, i, numbers.isel(estimator=i), tracks) | biases.get(str(name), {})
        for i, name in enumerate(dataset["estimator"].values)
    }


def _biases(dataset: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Return by estimator ``biases``: what it has made of each that it estimates, at the end, in SI units.

    Mean and standard deviation over the trials, and the standard deviation that it states, root mean square.
    """
    if "bias_estimate" not in dataset:
        return {}
    last = from_the_end(dataset[["bias_estimate", "bias_sigma"]]).isel(time=-1).load()
    units = [str(unit) for unit in dataset["bias_row_units"].values]
    found: dict[str, dict[str, Any]] = {}
    for name in dataset["estimator"].values:
        one, told = last.sel(estimator=name), dataset["bias_estimated"].sel(estimator=name).values
        value, sigma = (one[key].transpose("trial", "bias_row").values for key in ("bias_estimate", "bias_sigma"))
        own = {}
        for k in np.flatnonzero(told):
            known = np.isfinite(value[:, k]) & np.isfinite(sigma[:, k])
            mean, spread = (float(of(value[known, k])) if known.any() else math.nan for of in (np.mean, np.std))
            stated = float(np.sqrt(np.mean(sigma[known, k] ** 2))) if known.any() else math.nan
            numbers = {"mean": mean, "spread": spread, "sigma": stated}
            own[str(one["bias_row"].values[k])] = {"unit": units[k]} | {
                key: json_numbers(np.asarray(number)) for key, number in numbers.items()
            }
        found |= {str(name): {"biases": own}} if own else {}
    return found


def _summarise_one(known: Ensemble, i: int, consistency: xr.Dataset, tracks: bool) -> dict[str, Any]:
    dataset = known.dataset
    time = dataset["time"].values
    curves = {name: known.rmse(name).values[i] for name in known.quantities}
    missing = [None] * time.size

    def curve(name: str) -> list[float | None]:
        return json_numbers(curves[name]) if name in curves else list(missing)

    quantities = [name for name in QUANTITIES if name != "bias" or name in curves]
    summary: dict[str, Any] = {f"rmse_{name}_{_UNITS[name]}": curve(name) for name in quantities}
    summary["median_position_m"] = json_numbers(known.median_of_started.values[i])
    summary["nees_mean"] = json_numbers(consistency["nees"].values)
    summary["nis_mean"] = json_numbers(consistency["mean"].values)
    summary["nis_dof_mean"] = json_numbers(consistency["dof_mean"].values)
    for name in (bound for bound in BOUNDS if bound.rpartition("_")[2] in quantities):
        values = dataset[name].values[i] if name in dataset else np.full(time.size, np.nan)
        summary[f"{name}_{_UNITS[name.rpartition('_')[2]]}"] = json_numbers(values)
    summary["causal"] = causal(dataset, str(dataset["estimator"].values[i]))
    summary["not_started"] = int(known.sums["not_started"][i])
    summary["diverged"] = int(known.sums["diverged"][i])
    summary |= recovery_entry(part for _, part in blocks(dataset.isel(estimator=[i])))
    summary["armse_position_m"] = json_numbers(armse(curves["position"]))
    converged = convergence_time(time, curves["position"], dataset.attrs.get("convergence_m"))
    # tracks have no time in common
    summary["convergence_time_s"] = None if tracks else json_numbers(converged)
    return summary
