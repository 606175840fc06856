"""Results on disk: opening them, and their summary."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from quietfix.diagrams.chunks.ledger import Ledger, read_plan
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.result_schema import SCHEMA_VERSION, check_version, upgraded
from quietfix.diagrams.studies.store import check_store

__all__ = ["find_store", "open_result", "summary_of", "times_of", "write_summary"]


def find_store(path: Path | str) -> Path:
    """Return the ``results.zarr`` of a result, named by its folder or itself.

    Raises
    ------
    UserError
        If there is no result.
    """
    folder = Path(path)
    store = folder if folder.suffix == ".zarr" else folder / "results.zarr"
    if not store.is_dir():
        raise UserError(f"result: {path} is not a result; a folder with results.zarr, or results.zarr itself")
    return store


def open_result(path: Path | str) -> xr.Dataset:
    """Open a result by its folder or its ``results.zarr``; arrays are read when they are used.

    Of the kept chunks of an interrupted run these trials are there, and no others.

    Raises
    ------
    UserError
        If there is no result, it is not plain arrays, or a later version of Quietfix wrote it.
    """
    store = find_store(path)
    try:
        check_store(store)
        dataset = xr.open_zarr(store, consolidated=False, chunks=None)
    except UserError:
        raise
    except Exception as error:  # zarr and xarray raise a dozen kinds for a damaged store
        raise UserError(f"result: {store} cannot be read ({' '.join(str(error).split())})") from error
    return _finished(store, upgraded(dataset, check_version(dataset.attrs, f"result: {store}")))


def _finished(store: Path, dataset: xr.Dataset) -> xr.Dataset:
    """Return what is finished of a result; of one that is being written all has its place, and some is empty."""
    plan = read_plan(store.parent)
    if plan is None or "point" in dataset.dims or plan.trials != dataset.sizes.get("trial"):
        return dataset
    places = Ledger(store.parent, plan).places()
    behind = np.array_equal(places, np.arange(places.size))
    return dataset.isel(trial=slice(places.size) if behind else places)


def write_summary(
    path: Path,
    dataset: xr.Dataset,
    estimators: dict[str, Any],
    began: float,
    report: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Write ``summary.json`` and return what is in it; `report`: what a recording tells beside it."""
    summary = summary_of(dataset, estimators, began, report)
    path.write_text(json.dumps(summary, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    return summary


def summary_of(
    dataset: xr.Dataset, estimators: dict[str, Any], began: float, report: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return what ``summary.json`` holds: what was run, and numbers at every epoch by estimator."""
    told = dict(report or {})
    for name, numbers in told.pop("estimators", {}).items():
        estimators[name] |= numbers
    return {
        "schema_version": SCHEMA_VERSION,
        "system": dataset.attrs["system"],
        "variant": dataset.attrs["variant"] or None,
        "seed": int(dataset.attrs["seed"]),
        "first_trial": int(dataset.attrs["first_trial"]),
        "trials": int(dataset.sizes["trial"]),
        "version": dataset.attrs["version"],
        "run_seconds": round(time.monotonic() - began, 3),
        "time_s": times_of(dataset["time"].values),
        "estimators": estimators,
        **told,
    }


def times_of(values: Any) -> Any:
    """Return the epochs, of tracks of unequal length a list each."""
    return [times_of(one) if one.ndim else float(one) for one in values if one.ndim or not np.isnan(one)]
