"""Estimates as a table: one row for each estimator, target and epoch, with the covariance and the NIS."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.quantities.frame import frame_of
from quietfix.diagrams.quantities.states import POSITION, VELOCITY
from quietfix.diagrams.readers.stamps import write_stamps
from quietfix.diagrams.statistics.epochs import along
from quietfix.systems.earth.geodetic import ecef_to_geodetic, enu_rotation

__all__ = ["Columns", "estimate_columns", "state_columns", "write_estimates"]

Array = NDArray[np.float64]
Columns = dict[str, Any]

_EAST_NORTH_UP = ("east", "north", "up", "veast", "vnorth", "vup")


def estimate_columns(dataset: xr.Dataset, began: tuple[int, float] | None = None) -> Columns:
    """Return the columns of a table of estimates.

    Parameters
    ----------
    dataset : xarray.Dataset
        Result of a study that kept covariances; epochs that a target does not have are left out.
    began : (int, float), optional
        t = 0 in seconds of TAI since 1970, whole ones and the rest.

    Returns
    -------
    dict of str to sequence, one after the other by estimator, target and time
        ``estimator``, ``target``, ``time`` (UTC, with a date), ``time_s``; Earth-fixed states as ``latitude_deg``,
        ``longitude_deg``, ``height_m`` (WGS 84), ``veast_mps``, ``vnorth_mps``, ``vup_mps``, others as ``x_m`` ...;
        ``cov_A_B``, the upper half of the covariance in the same axes (Earth-fixed: east, north, up) and SI units;
        ``nis``, ``nis_dof``; ``innovation_ROW``, SI units, where the result has it.
    """
    axis = along(dataset)
    names = [str(name) for name in dataset["state"].values]
    estimate = dataset["estimate"].transpose("estimator", "trial", axis, "state").values
    time = np.broadcast_to(dataset["time"].values, estimate.shape[1:3])
    there = np.broadcast_to(np.isfinite(time), estimate.shape[:3])
    targets = dataset["track"].values if "track" in dataset.coords else dataset["trial"].values
    index = np.nonzero(there)
    seconds = np.broadcast_to(time, estimate.shape[:3])[there]
    columns: Columns = {
        "estimator": dataset["estimator"].values[index[0]].tolist(),
        "target": [str(name) for name in targets[index[1]].tolist()],
        **({} if began is None else {"time": write_stamps(began, seconds)}),
        "time_s": seconds,
    }
    covariance = dataset["covariance"].transpose("estimator", "trial", axis, "state", "state_").values[there]
    units = [str(unit) for unit in dataset["state_units"].values]
    columns |= state_columns(estimate[there], covariance, names, units, frame_of(dataset).geodetic)
    for port in ("nis", "nis_dof"):
        columns[port] = dataset[port].transpose("estimator", "trial", axis).values[there]
    if "innovation" in dataset:
        innovation = dataset["innovation"].transpose("estimator", "trial", axis, "innovation_row").values[there]
        rows = dataset["innovation_row"].values
        columns |= {f"innovation_{row}": innovation[:, i] for i, row in enumerate(rows)}
    return columns


def state_columns(
    estimate: Array, covariance: Array, names: Sequence[str], units: Sequence[str], geodetic: bool
) -> Columns:
    """Return columns of states (rows, n) and covariances (rows, n, n), as `estimate_columns` has them.

    Parameters
    ----------
    estimate, covariance : ndarray
        SI units.
    names, units : sequence of str
        Of the components of the states.
    geodetic : bool
        Whether the axes are fixed to the Earth: with places by latitude, longitude and height.
    """
    suffixes = dict(zip(names, units, strict=True))
    place = [names.index(name) for name in POSITION if name in names]
    moving = [names.index(name) for name in VELOCITY if name in names]
    labels, values, columns = list(names), estimate.copy(), {}
    shown = [f"{name}_{_suffix(suffixes[name])}" for name in names]
    if geodetic and len(place) == 3:
        latitude, longitude, height = ecef_to_geodetic(estimate[:, place])
        columns = {"latitude_deg": np.degrees(latitude), "longitude_deg": np.degrees(longitude), "height_m": height}
        rotation = enu_rotation(np.nan_to_num(latitude), np.nan_to_num(longitude))
        turn = np.broadcast_to(np.eye(len(names)), (len(estimate), len(names), len(names))).copy()
        for axes in (place, moving):
            if len(axes) == 3:
                turn[:, np.array(axes)[:, None], axes] = rotation
        for i, name in zip([*place, *moving], _EAST_NORTH_UP, strict=False):
            labels[i], shown[i] = name, f"{name}_mps"
        with np.errstate(invalid="ignore"):
            covariance = turn @ covariance @ turn.swapaxes(-1, -2)
            values = (turn @ estimate[..., None])[..., 0]
        columns |= {shown[i]: values[:, i] for i in range(len(names)) if i not in place}
    else:
        columns = {shown[i]: values[:, i] for i in range(len(names))}
    for i, first in enumerate(labels):
        columns |= {f"cov_{first}_{labels[j]}": covariance[:, i, j] for j in range(i, len(labels))}
    return columns


def _suffix(unit: str) -> str:
    return {"m/s": "mps", "m/s^2": "mps2", "1": "", "": ""}.get(unit, unit)


def write_estimates(columns: Mapping[str, Any], folder: Path) -> list[Path]:
    """Write ``estimates.csv`` and ``estimates.parquet``, numbers with all their digits; what is not known is empty."""
    path = folder / "estimates.csv"
    listed = [_cells(column) for column in columns.values()]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*listed, strict=True))
    return [path, *_parquet(columns, folder / "estimates.parquet")]


def _cells(column: Any) -> list[Any]:
    if isinstance(column, list):
        return column
    return [None if value != value else value for value in column.tolist()]


def _parquet(columns: Mapping[str, Any], path: Path) -> list[Path]:
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table({name: pa.array(column, from_pandas=True) for name, column in columns.items()}), path)
    return [path]
