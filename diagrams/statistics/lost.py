"""Which trials are lost at the end, and which never started."""

from __future__ import annotations

import numpy as np
import xarray as xr

from quietfix.diagrams.statistics.epochs import along
from quietfix.diagrams.statistics.state_errors import errors

__all__ = ["beyond", "diverged", "idle", "not_started"]


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
