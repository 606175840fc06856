"""Which trials are lost at the end, and which never started; and what estimators say of their own trouble."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.statistics.epochs import along
from quietfix.diagrams.statistics.state_errors import errors

__all__ = ["beyond", "diverged", "flagged", "idle", "not_started", "recovery_entry", "recovery_lines"]

Array = NDArray[np.float64]


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
    found = errors(dataset, ("position",))["position"]
    return beyond(found, float(dataset.attrs["divergence_m"] if limit is None else limit))


def not_started(dataset: xr.Dataset) -> xr.DataArray:
    """Return which trials never started: no epoch has a finite position, although the truth is known at some.

    Returns
    -------
    xarray.DataArray of bool, dims (estimator, trial)
        Such a trial has no error to be counted in an RMSE, as a lost one has: it is counted apart.
    """
    return idle(errors(dataset, ("position",))["position"])


def idle(position: xr.DataArray) -> xr.DataArray:
    """Return the same of position errors (estimator, trial, time)."""
    axis = along(position)
    return position.notnull().any(axis) & ~(abs(position) < np.inf).any(axis)


def beyond(position: xr.DataArray, limit: float) -> xr.DataArray:
    """Return what `diverged` does of position errors (estimator, trial, time) [m]."""
    known = position.notnull()
    axis = along(position)
    last = known.sizes[axis] - 1 - known.isel({axis: slice(None, None, -1)}).argmax(axis)
    return position.isel({axis: last}).drop_vars("time", errors="ignore") > limit


def flagged(dataset: xr.Dataset) -> Array | None:
    """Return whether each estimator calls each trial lost, (estimator, trial, 2): at its last epoch, and ever.

    None where a result does not say it, as those of earlier versions.
    """
    if "lost" not in dataset:
        return None
    lost = dataset["lost"].transpose("estimator", "trial", along(dataset)).values
    return np.stack([_last(lost), np.nanmax(np.nan_to_num(lost), axis=-1)], axis=-1)


def _last(values: Array) -> Array:
    """Return the last number of each row that is one; 0 where there is none."""
    known = np.isfinite(values)
    place = values.shape[-1] - 1 - np.argmax(known[..., ::-1], axis=-1)
    return np.nan_to_num(np.take_along_axis(values, place[..., None], axis=-1)[..., 0])


def recovery_entry(parts: Iterable[xr.Dataset]) -> dict[str, Any]:
    """Return what a result of one estimator says of its trouble.

    Parameters
    ----------
    parts : iterable of Dataset
        The result, some trials after the other.

    Returns
    -------
    dict
        ``lost`` and ``ever_lost``, trials that the estimator calls lost at the end and at any epoch (None: not known);
        where it has a gate ``rejected_rows`` and ``releases``, and where it may begin again ``restarts`` and
        ``restarted_trials``, over all trials.
    """
    sums: dict[str, int] = {}
    for part in parts:
        for key, number in _numbers(part).items():
            sums[key] = sums.get(key, 0) + number
    return {"lost": None, "ever_lost": None, **sums}


def _numbers(dataset: xr.Dataset) -> dict[str, int]:
    """Return the same of some of the trials, without what is not known."""
    name = str(dataset["estimator"].values[0])
    flags = flagged(dataset)
    entry: dict[str, int] = {}
    if flags is not None:
        at_end, ever = flags[0].sum(axis=0)
        entry = {"lost": int(at_end), "ever_lost": int(ever)}
    for port, key in (("rejected", "rejected_rows"), ("releases", "releases"), ("restarts", "restarts")):
        if (found := dataset.get(f"{port}_{name}")) is not None:
            counts = _last(found.transpose("trial", ..., along(dataset)).values)
            entry[key] = int(counts.sum())
            if port == "restarts":
                entry["restarted_trials"] = int((counts > 0).sum())
    return entry


def recovery_lines(rows: Mapping[str, Mapping[str, Any]], trials: int) -> list[str]:
    """Return a line for each estimator that has something to tell, from entries as of `recovery_entry`."""
    lines = []
    for name, row in rows.items():
        told = []
        if row.get("lost") or row.get("ever_lost"):
            told.append(f"calls itself lost in {row['ever_lost']} of {trials} trials, at the end in {row['lost']}")
        if "rejected_rows" in row:
            told.append(f"{row['rejected_rows']} rows rejected, the gate opened {row['releases']} times")
        if row.get("restarts"):
            told.append(f"{row['restarts']} new beginnings in {row['restarted_trials']} trials")
        if told:
            lines.append(f"{name}: {'; '.join(told)}")
    return lines
