"""The axis along which a trial goes on: the time, or the epochs of tracks of unequal length.

A result of a recording of several tracks has the dimension ``epoch`` in the place of ``time``, and ``time`` as a
coordinate (trial, epoch): NaN beyond the end of a track, as everything else is there.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

__all__ = ["along", "by_number", "from_the_end"]


def along(of: xr.Dataset | xr.DataArray) -> str:
    """Return the name of the axis: ``time``, or ``epoch`` where the tracks are of unequal length."""
    return "epoch" if "epoch" in of.dims else "time"


def by_number(dataset: xr.Dataset) -> xr.Dataset:
    """Return a result whose tracks begin together: ``time`` counts the epochs of each, from 1.

    One without tracks of unequal length is returned as it is.
    """
    if along(dataset) == "time":
        return dataset
    counted = dataset.drop_vars("time").rename_dims(epoch="time")
    return counted.assign_coords(time=1.0 + np.arange(dataset.sizes["epoch"])).assign_attrs(axis="epoch of the track")


def from_the_end(dataset: xr.Dataset) -> xr.Dataset:
    """Return a result whose tracks end together: ``time`` counts the epochs of each backwards, the last is 0.

    One without tracks of unequal length is returned as it is.
    """
    if along(dataset) == "time":
        return dataset
    longest = dataset.sizes["epoch"]
    lengths = np.isfinite(dataset["time"].transpose("trial", "epoch").values).sum(axis=-1)
    place = np.arange(longest) - (longest - lengths[:, None])
    where = xr.DataArray(np.maximum(place, 0), dims=("trial", "time"))
    there = xr.DataArray(place >= 0, dims=("trial", "time"))
    moving = [name for name in dataset.data_vars if "epoch" in dataset[name].dims]
    moved = dataset[moving].drop_vars("time").isel(epoch=where).where(there)
    others = dataset.drop_vars([*moving, "time"]).drop_dims("epoch", errors="ignore")
    ended = others.assign({name: moved[name] for name in moving})
    return ended.assign_coords(time=np.arange(1.0 - longest, 1.0)).assign_attrs(axis="epochs before the last")
