"""Sums over the trials of a study: those of its chunks, added in their order, are those of all.

A floating point sum depends on its order. With that of the chunks the numbers of a study are the same to the last bit
whoever has run them, and whenever; and no more than a chunk of trials is ever read at once.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.statistics.consistency import consistency_sums
from quietfix.diagrams.statistics.epochs import by_number
from quietfix.diagrams.statistics.lost import beyond, idle
from quietfix.diagrams.statistics.quantiles import Columns, percentiles_of
from quietfix.diagrams.statistics.state_errors import QUANTITIES, errors

__all__ = ["Ensemble", "Tally", "blocks", "range_over_trials", "tally", "tally_of", "together"]

Array = NDArray[np.float64]
Tally = dict[str, Array]
"""Sums by name. ``squares_QUANTITY`` and ``known_QUANTITY`` (estimator, time): sum of the squared errors of the trials
that started, infinite where one is lost, and how many have one; ``idle_QUANTITY``: how many of the others would.
``nees``, ``nis``, ``nis_dof``, and ``nees_known``, ``nis_known`` (estimator, time): sums, and of how many trials.
``not_started``, ``diverged`` (estimator)."""

_READ = ("truth", "estimate", "nees", "nis", "nis_dof")


def trial_blocks(dataset: xr.Dataset) -> list[slice]:
    """Return the trials of a result in blocks: the chunks that it was run in, or all at once where it is in memory.

    Sums over trials are added up block by block, so they are those of the run to the last bit.
    """
    count = dataset.sizes["trial"]
    width = min(
        (v.encoding["preferred_chunks"]["trial"] for v in dataset.data_vars.values() if _stored(v)), default=count
    )
    return [slice(begin, min(begin + width, count)) for begin in range(0, count, max(1, width))]


def _stored(variable: xr.DataArray) -> bool:
    return "trial" in variable.dims and "trial" in variable.encoding.get("preferred_chunks", {})


def blocks(dataset: xr.Dataset) -> Iterator[tuple[slice, xr.Dataset]]:
    """Yield the trials of a result block by block: which they are, and their part of it."""
    for trials in trial_blocks(dataset):
        yield trials, dataset.isel(trial=trials)


def tally_of(chunk: xr.Dataset) -> Tally:
    """Return the sums of the trials of a chunk of a study's result; nothing where nothing is estimated."""
    if "estimator" not in chunk.coords or not set(_READ) <= set(chunk):
        return {}
    read = by_number(chunk[[*_READ]]).load()
    each = [_of_one(read.isel(estimator=[i])) for i in range(read.sizes["estimator"])]
    return {name: np.concatenate([one[name] for one in each]) for name in each[0]}


def _of_one(dataset: xr.Dataset) -> Tally:
    found = errors(dataset)
    never = idle(found["position"])
    found_started = found.where(~never)
    sums: Tally = {}
    for what in found:
        error = found_started[what]
        known = error.notnull()
        sums[f"squares_{what}"] = (error**2).where(known, 0.0).sum("trial").values
        sums[f"known_{what}"] = known.sum("trial").values.astype(float)
        sums[f"idle_{what}"] = (found[what].notnull() & never).sum("trial").values.astype(float)
    sums |= consistency_sums(dataset)
    sums["not_started"] = never.sum("trial").values.astype(float)
    limit = float(dataset.attrs.get("divergence_m", np.inf))
    sums["diverged"] = beyond(found_started["position"], limit).sum("trial").values.astype(float)
    return sums


def together(parts: Iterable[Mapping[str, Array]]) -> Tally:
    """Return the sums of the chunks of a study, added in the order that is given."""
    total: Tally = {}
    for part in parts:
        total = {name: total[name] + values if name in total else np.asarray(values) for name, values in part.items()}
    return total


def tally(dataset: xr.Dataset) -> Tally:
    """Return the sums of all trials of a result, which is read chunk by chunk."""
    return together(tally_of(block) for _, block in blocks(dataset))


def range_over_trials(numbers: xr.DataArray) -> Array:
    """Return the smallest, the median and the largest over the trials, (3, time), of numbers (trial, time)."""
    columns = Columns(numbers.sizes["trial"], numbers.size // max(1, numbers.sizes["trial"]))
    for trials, block in blocks(numbers.to_dataset(name="numbers")):
        columns.put(trials.start, block["numbers"].values)
    found = [np.stack([n.min(axis=0), np.median(n, axis=0), n.max(axis=0)]) for _, n in columns.take()]
    columns.close()
    return np.concatenate(found, axis=-1)


class Ensemble:
    """What can be told of all trials of a study, with no more than a chunk of them read at once.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result.
    sums : mapping, optional
        Those of its trials, where they are known already; see `Tally`.

    Attributes
    ----------
    dataset : xarray.Dataset
        The result; of tracks of unequal length as `quietfix.diagrams.statistics.epochs.by_number` gives it.
    """

    def __init__(self, dataset: xr.Dataset, sums: Mapping[str, Array] | None = None) -> None:
        self.dataset = by_number(dataset)
        self._given = sums

    @cached_property
    def sums(self) -> Mapping[str, Array]:
        """See `Tally`."""
        return self._given or tally(self.dataset)

    @property
    def quantities(self) -> list[str]:
        """What there are errors of, in the order of `QUANTITIES`."""
        return [what for what in QUANTITIES if f"squares_{what}" in self.sums]

    def judged(self, quantity: str) -> bool:
        """Return whether any trial has an error of it."""
        return any(float(self.sums[f"{kind}_{quantity}"].sum()) > 0 for kind in ("known", "idle"))

    def rmse(self, quantity: str) -> xr.DataArray:
        """Return the root mean square error over the trials that started.

        Parameters
        ----------
        quantity : str
            One of `quantities`.

        Returns
        -------
        xarray.DataArray, dims (estimator, time)
            NaN where no truth is known.
        """
        squares, known = self.sums[f"squares_{quantity}"], self.sums[f"known_{quantity}"]
        with np.errstate(invalid="ignore"):
            return self._curve((squares / np.where(known > 0, known, np.nan)) ** 0.5)

    def _curve(self, values: Array) -> xr.DataArray:
        names = {name: self.dataset[name] for name in ("estimator", "time")}
        return xr.DataArray(values, names, ("estimator", "time"))

    @property
    def median_of_started(self) -> xr.DataArray:
        """Median of the position errors of the trials that started (estimator, time) [m]."""
        return self._curve(self._percentiles[0])

    @property
    def ninety_of_started(self) -> xr.DataArray:
        """The 90 % point of the same."""
        return self._curve(self._percentiles[1])

    @cached_property
    def _percentiles(self) -> Array:
        """Return the two (2, estimator, time), in one pass over the result."""
        sizes = {name: self.dataset.sizes[name] for name in ("estimator", "trial", "time")}
        count, epochs = sizes["trial"], sizes["time"]
        never = np.zeros((sizes["estimator"], count), dtype=bool)
        columns = Columns(count, sizes["estimator"] * epochs)
        for trials, block in blocks(self.dataset[["truth", "estimate"]]):
            position = errors(block.load(), ("position",))["position"].transpose("trial", "estimator", "time")
            never[:, trials] = idle(position).transpose("estimator", "trial").values
            columns.put(trials.start, position.values.reshape(position.sizes["trial"], -1))
        found = []
        for some, numbers in columns.take():
            out = never[np.arange(some.start, some.stop) // epochs].T
            found.append(percentiles_of(np.where(out, np.nan, numbers) if out.any() else numbers, (50.0, 90.0)))
        columns.close()
        return np.concatenate(found, axis=-1).reshape(2, sizes["estimator"], epochs)
