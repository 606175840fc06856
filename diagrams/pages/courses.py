"""Single trials from beginning to end, as numbers for a page: the worst, the middle, the best, and as many as fit."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.pages.numbers import packed, rounded, thinned
from quietfix.diagrams.pages.places import error_axes, place_names
from quietfix.diagrams.quantities.frame import frame_of
from quietfix.diagrams.statistics.epochs import along

__all__ = ["courses", "final_errors"]

Array = NDArray[np.float64]

_ROOM = 1_000_000  # bytes of single precision in all, so that the page stays below 5 MB
_FEWEST_EPOCHS, _MOST_EPOCHS = 30, 400
_PICKS = ("worst", "median", "best")
_BLOCK = 4000  # trials read at once


def final_errors(dataset: xr.Dataset) -> Array:
    """Return position errors (estimator, trial) [m] at the last epoch of each trial with a known truth.

    Trials are read in blocks; infinite where an estimate is not finite, NaN where no truth is known.
    """
    names, axis = place_names(dataset), along(dataset)
    parts = []
    for begin in range(0, dataset.sizes["trial"], _BLOCK):
        block = dataset[["truth", "estimate"]].isel(trial=slice(begin, begin + _BLOCK))
        if axis == "time":
            block = block.isel(time=slice(-1, None))
        block = block.sel(state=names)
        truth, estimate = xr.broadcast(block["truth"], block["estimate"])
        order = ("estimator", "trial", axis, "state")
        true, found = truth.transpose(*order).values, estimate.transpose(*order).values
        size = np.sqrt(np.square(found - true).sum(axis=-1))
        known = np.isfinite(true).all(axis=-1)
        size = np.where(known, np.where(np.isfinite(size), size, np.inf), np.nan)
        last = known.shape[-1] - 1 - known[..., ::-1].argmax(axis=-1)
        parts.append(np.take_along_axis(size, last[..., None], axis=-1)[..., 0])
    return np.concatenate(parts, axis=1)


def courses(dataset: xr.Dataset) -> dict[str, Any] | None:
    """Return errors, claimed covariance, NEES and NIS of single trials, thinned to what a page may hold.

    Parameters
    ----------
    dataset : xarray.Dataset
        The result; of its trials only those that are shown are read whole.

    Returns
    -------
    dict or None
        ``trials``: their numbers; ``picks``: by estimator its worst, middle and best one; ``axes``: in which errors
        are; ``columns``: what is told of each epoch; ``data``: base64 of single precision (estimator, trial, epoch,
        column). None where no truth is known.
    """
    names, axis = place_names(dataset), along(dataset)
    if not names or "truth" not in dataset or axis == "epoch":
        return None
    final = final_errors(dataset)
    judged = ~np.isnan(final).all(axis=0)
    if not judged.any():
        return None
    labels, rotation = error_axes(frame_of(dataset), len(names))
    has_covariance = "covariance" in dataset
    columns = [*labels, *(_terms(labels) if has_covariance else []), "nees", "nis"]
    picks = _picks(final)
    first = list(
        dict.fromkeys(i for what in ("worst", "median", "best") for row in picks if what in row for i in (row[what],))
    )
    epoch_bytes = 4 * dataset.sizes["estimator"] * len(columns)
    epochs = thinned(
        dataset.sizes[axis], int(np.clip(_ROOM // (epoch_bytes * len(first)), _FEWEST_EPOCHS, _MOST_EPOCHS))
    )
    wanted = _shown(final, first, _ROOM // (epoch_bytes * len(epochs)))
    part = dataset.isel({"trial": wanted, axis: epochs})
    values = _values(part, names, rotation, has_covariance)
    numbers = dataset["trial"].values
    return {
        "trials": [int(numbers[i]) for i in wanted],
        "picks": {
            str(name): {what: int(numbers[i]) for what, i in row.items()}
            for name, row in zip(dataset["estimator"].values, picks, strict=True)
        },
        "final": [[rounded(final[e, i]) for i in wanted] for e in range(final.shape[0])],
        "axes": labels,
        "columns": columns,
        "time": rounded(part[axis].values),
        "data": packed(values),
        "covariance": has_covariance,
        "left_out": int(final.shape[1] - len(wanted)),
    }


def _terms(labels: list[str]) -> list[str]:
    """Return names of the covariances that are told: all of the first two axes, and the variance of the third."""
    return ["c00", "c01", "c11"] + (["c22"] if len(labels) > 2 else [])


def _picks(final: Array) -> list[dict[str, int]]:
    """Return places of the worst, middle and best trial of each estimator, of those with a known error."""
    picks: list[dict[str, int]] = []
    for row in final:
        known = np.flatnonzero(~np.isnan(row))
        order = known[np.argsort(row[known], kind="stable")]
        ends = (
            {"worst": int(order[-1]), "median": int(order[len(order) // 2]), "best": int(order[0])}
            if known.size
            else {}
        )
        picks.append(ends)
    return picks


def _shown(final: Array, first: list[int], room: int) -> list[int]:
    """Return places of the trials that are shown, in order: picked ones, the worst of all, then from the first on."""
    worst = np.argsort(-np.nan_to_num(final, nan=-1.0, posinf=np.inf).max(axis=0), kind="stable")
    in_order = list(dict.fromkeys([*first, *map(int, worst[:5]), *range(final.shape[1])]))
    return sorted(in_order[: max(room, len(first))])


def _values(part: xr.Dataset, names: list[str], rotation: Any, has_covariance: bool) -> Array:
    axis = along(part)
    placed = part[["truth", "estimate"]].sel(state=names)
    truth, estimate = xr.broadcast(placed["truth"], placed["estimate"])
    order = ("estimator", "trial", axis, "state")
    true, found = truth.transpose(*order).values, estimate.transpose(*order).values
    turned = rotation(true)
    with np.errstate(invalid="ignore"):
        columns = [np.einsum("...ij,...j->...i", turned, found - true)]
        if has_covariance:
            columns.append(_covariances(part, names, turned))
    freedom = part["nis_dof"].transpose(*order[:3]).values
    with np.errstate(invalid="ignore", divide="ignore"):
        nis = np.where(freedom > 0, part["nis"].transpose(*order[:3]).values / freedom, np.nan)
    columns += [part["nees"].transpose(*order[:3]).values[..., None], nis[..., None]]
    return np.concatenate(columns, axis=-1)


def _covariances(part: xr.Dataset, names: list[str], turned: Array) -> Array:
    axis = along(part)
    rows, other = (name for name in part["covariance"].dims if name not in ("estimator", "trial", axis))
    matrix = part["covariance"].sel({rows: names, other: names})
    both = matrix.transpose("estimator", "trial", axis, rows, other).values
    found = np.einsum("...ij,...jk,...lk->...il", turned, both, turned)
    terms = [found[..., 0, 0], found[..., 0, 1], found[..., 1, 1]]
    if len(names) > 2:
        terms.append(found[..., 2, 2])
    return np.stack(terms, axis=-1)
