"""Trials that never started, and why, as far as a study's result tells."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.assembly.build import Assembly
from quietfix.diagrams.assembly.find import Found
from quietfix.diagrams.statistics.lost import not_started
from quietfix.diagrams.statistics.tally import blocks

__all__ = ["arrivals", "counted", "say_unmeasured", "why_not_started", "why_this"]

Array = NDArray[np.float64]

_ONE_PLACE = 1e-3  # m
_AN_INSTANT = 1e-9  # s


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
    if "dropped_rows" in dataset.coords:
        for name in map(str, dataset["estimator"].values):
            count = int(dataset["dropped_rows"].sel(estimator=name).sum())
            if count:
                lines.append(f"{name}: {count} rows came later than its buffer reaches, and are left out")
    return lines


def counted(wired: Assembly, course: Mapping[str, Array], present: NDArray[np.bool_], size: int) -> dict[str, Any]:
    """Return coordinates that count rows of each trial of a chunk.

    Parameters
    ----------
    wired : Assembly
    course : mapping of str to ndarray, shape (time, trials, size)
        See `Assembly.course`.
    present : ndarray of bool, shape (trials or 1, time, rows)
        Which rows were measured.
    size : int
        Trials of the chunk.
    """
    rows = np.broadcast_to(present.sum(axis=-1).max(axis=-1), size)
    found: dict[str, Any] = {"measured_rows": ("trial", rows, {"rows": present.shape[-1]})}
    names = list(wired.estimators)
    if any(f"{name}/dropped" in course for name in names):
        dropped = [course[f"{n}/dropped"][-1, :size, 0] if f"{n}/dropped" in course else np.zeros(size) for n in names]
        found["dropped_rows"] = (("estimator", "trial"), np.stack(dropped).astype(int))
    return found


def arrivals(course: Mapping[str, Array], size: int) -> Array | None:
    """Return when what is measured comes (trials, time, rows) [s], where some is late; arguments as of `counted`."""
    return course["arrival"].swapaxes(0, 1)[:size] if "arrival" in course else None


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


def say_unmeasured(found: Found, wired: Assembly, present: NDArray[np.bool_], arrival: Array | None = None) -> None:
    """Say which rows no estimator gets in the first chunk: of a user's system that are not measured, or come too late.

    Parameters
    ----------
    found : Found
    wired : Assembly
    present : ndarray of bool, shape (trials or 1, time, rows)
        Which rows were measured.
    arrival : ndarray, shape (trials, time, rows), optional
        When each comes [s], where some is late.
    """
    stream = wired.stream or next((list(e.wiring.stream) for e in wired.estimators.values()), [])
    seen: Any = np.any(present, axis=(0, 1))
    never = [row for row, once in zip(stream, seen, strict=False) if not once]
    if never and found.source != "packaged":
        warnings.warn(f"{', '.join(never)}: never measured in this run (NaN at all epochs)", stacklevel=1)
    if arrival is None:
        return
    end = wired.clock.ticks(wired.duration)[-1]
    with np.errstate(invalid="ignore"):
        comes = np.any(present & (arrival <= end + _AN_INSTANT), axis=(0, 1))
    late = [row for row, once, come in zip(stream, seen, comes, strict=False) if once and not come]
    if late:
        warnings.warn(f"{', '.join(late)}: measured, but all of it comes after the end at {end:g} s", stacklevel=1)
