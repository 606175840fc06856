"""Trials that never started, and why, as far as a study's result tells."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
import xarray as xr

from quietfix.diagrams.statistics.metrics import not_started

__all__ = ["why_not_started"]

_ONE_PLACE = 1e-3  # m


def why_not_started(dataset: xr.Dataset, counts: Mapping[str, int]) -> list[str]:
    """Return one line for each estimator with trials that never started.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result.
    counts : mapping of str to int
        How many trials of each estimator never started.
    """
    lines = []
    for name, count in counts.items():
        if count:
            never = not_started(dataset.sel(estimator=[name])).values[0]
            lines.append(
                f"{name}: {count} of {dataset.sizes['trial']} trials never started and are in no RMSE: "
                f"{_reason(dataset, never)}"
            )
    return lines


def _reason(dataset: xr.Dataset, never: Any) -> str:
    """Return what those trials have in common."""
    platforms = dataset["platforms"]
    places = platforms.isel(trial=np.flatnonzero(never)) if "trial" in platforms.dims else platforms
    position = places.transpose(..., "platform", "coordinate").values[..., :3]
    names = [str(name) for name in places["platform"].values]
    for i, j in combinations(range(len(names)), 2):
        apart = np.linalg.norm(position[..., i, :] - position[..., j, :], axis=-1)
        if np.all(apart < _ONE_PLACE):
            return f"platforms {names[i]} and {names[j]} are in one place"
    if "measured_rows" in dataset.coords:
        most = dataset["measured_rows"].values[never]
        if most.max() == 0:
            return "nothing is measured at any epoch (out of sight, or all rows dropped)"
        if most.max() < dataset["measured_rows"].attrs["rows"]:
            rows = dataset["measured_rows"].attrs["rows"]
            return f"at most {most.max()} of {rows} rows are measured at once, and the start finds no solution in them"
    return "the start finds no solution at any epoch"
