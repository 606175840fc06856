"""Trials that never started, and why, as far as a study's result tells."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
import xarray as xr

from quietfix.diagrams.statistics.lost import not_started
from quietfix.diagrams.statistics.tally import blocks

__all__ = ["why_not_started", "why_this"]

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
            reason = _Reason(dataset)
            for trials, block in blocks(dataset):
                reason.see(dataset.isel(trial=trials), not_started(block.sel(estimator=[name])).values[0])
            lines.append(
                f"{name}: {count} of {dataset.sizes['trial']} trials never started and are in no RMSE: {reason.words()}"
            )
    return lines


def why_this(dataset: xr.Dataset) -> str:
    """Return why one trial, that of a result of no more, never started."""
    reason = _Reason(dataset)
    reason.see(dataset, np.ones(1, dtype=bool))
    return reason.words()


class _Reason:
    """What trials that never started have in common, as far as a result tells."""

    def __init__(self, dataset: xr.Dataset) -> None:
        platforms = [str(name) for name in dataset["platform"].values]
        self._close = dict.fromkeys(combinations(platforms, 2), True)
        self._most = 0 if "measured_rows" in dataset.coords else None
        self._rows = dataset["measured_rows"].attrs.get("rows", 0) if self._most == 0 else 0

    def see(self, block: xr.Dataset, never: Any) -> None:
        """Take some trials of the result, and which of them never started."""
        if not never.any():
            return
        self._see_places(block["platforms"], never)
        if self._most is not None:
            self._most = max(self._most, int(block["measured_rows"].values[never].max()))

    def _see_places(self, platforms: xr.DataArray, never: Any) -> None:
        places = platforms.isel(trial=np.flatnonzero(never)) if "trial" in platforms.dims else platforms
        position = places.transpose(..., "platform", "coordinate").values[..., :3]
        names = [str(name) for name in places["platform"].values]
        for i, j in combinations(range(len(names)), 2):
            apart = np.linalg.norm(position[..., i, :] - position[..., j, :], axis=-1)
            self._close[names[i], names[j]] &= bool(np.all(apart < _ONE_PLACE))

    def words(self) -> str:
        """Return what they have in common."""
        for (one, other), close in self._close.items():
            if close:
                return f"platforms {one} and {other} are in one place"
        if self._most == 0:
            return "nothing is measured at any epoch (out of sight, or all rows dropped)"
        if self._most is not None and self._most < self._rows:
            most = f"at most {self._most} of {self._rows} rows are measured at once"
            return f"{most}, and the start finds no solution in them"
        return "the start finds no solution at any epoch"
