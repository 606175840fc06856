"""What ``quietfix export`` does: a result as NetCDF, or as one table, block by block."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv as csv
import pyarrow.parquet as parquet
import xarray as xr

from quietfix.diagrams.commands.results.opened import Opened, opened, reading
from quietfix.diagrams.console.answer import tell
from quietfix.diagrams.console.terminal import done
from quietfix.diagrams.quantities.frame import UNITS
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.epochs import along
from quietfix.diagrams.statistics.state_errors import errors
from quietfix.diagrams.statistics.tally import blocks
from quietfix.diagrams.writers.whole_file import written_beside

__all__ = ["export_command", "tables_of"]

_FORMATS = (".nc", ".csv", ".parquet")
_LARGEST = 1 << 31  # bytes; NetCDF 3 is written from memory
_ROWS = 200_000  # of the table at once
_FIRST = ("truth", "estimate", "nees", "nis", "nis_dof", "position_error")  # of the columns; the others by their names


def export_command(path: Path, file: Path, overwrite: bool) -> None:
    """Write a result in another format; see ``quietfix export --help``."""
    kind = file.suffix.lower()
    if kind not in _FORMATS:
        raise UserError(f"FILE: {file} is not allowed; a name that ends in {', '.join(_FORMATS)}")
    if file.is_file() and not overwrite:
        raise UserError(f"FILE: {file} exists; add --overwrite or choose another name")
    result = opened(path, "export")
    with written_beside(file) as beside, reading(path, "export"):
        told = _netcdf(result, beside) if kind == ".nc" else _table(result, beside, kind)
    tell(file=str(file), **told)
    size = f"{told['rows']} rows of {len(told['columns'])} columns" if "rows" in told else ", ".join(told["variables"])
    done(f"wrote {file}: {size}")


# ---------------------------------------------------------------------------------------------------- NetCDF


def _netcdf(result: Opened, file: Path) -> dict[str, Any]:
    """Write a Dataset as NetCDF 3 with 64-bit offsets, which needs no further library."""
    dataset = result.dataset
    size = sum(variable.size * max(8, variable.dtype.itemsize) for variable in dataset.variables.values())
    if size > _LARGEST:
        raise UserError(
            f"export: {result.path} has {size / 1e9:.1f} GB, and NetCDF is written up to {_LARGEST / 1e9:.1f} GB; "
            "export to .parquet, or open results.zarr with xarray"
        )
    plain = dataset.load().drop_encoding()
    # NetCDF 3 has no 64-bit whole numbers: those that do not fit into 32 bits become floating point
    for name, variable in plain.variables.items():
        if variable.dtype.kind in "iu" and variable.size and int(np.abs(variable.values).max()) >= 1 << 31:
            plain = plain.assign_coords({name: variable.astype(float)})
    large = {key: str(value) for key, value in plain.attrs.items() if isinstance(value, int) and abs(value) >= 1 << 31}
    plain.attrs |= large
    plain.to_netcdf(file, engine="scipy", format="NETCDF3_64BIT")
    return {"format": "NetCDF 3, 64-bit offsets", "variables": [str(name) for name in plain.data_vars]}


# ----------------------------------------------------------------------------------------------------- table


def _table(result: Opened, file: Path, kind: str) -> dict[str, Any]:
    """Write the tables of the blocks one after the other."""
    count, writer = 0, None
    try:
        for table in tables_of(result.dataset):
            if writer is None:
                text = {"quietfix": json.dumps({key: _plain(v) for key, v in result.dataset.attrs.items()})}
                schema = table.schema.with_metadata(text)
                writer = parquet.ParquetWriter(file, schema) if kind == ".parquet" else csv.CSVWriter(file, schema)
            writer.write_table(table.cast(schema))
            count += table.num_rows
    finally:
        if writer is not None:
            writer.close()
    return {"format": kind.removeprefix("."), "rows": count, "columns": list(schema.names)}


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def tables_of(dataset: xr.Dataset) -> Iterator[pa.Table]:
    """Yield a result as tables with the same columns.

    A row for each estimator, trial and epoch (of a sweep: each point, estimator and trial). Other dimensions, states
    and rows and platforms, become columns, ``NAME_STATE``; the errors stand beside them, as ``QUANTITY_error_UNIT``.
    What is not known is null; what is lost infinite.
    """
    axis = along(dataset)
    rows = ("point", "estimator", "trial") if "point" in dataset.dims else ("estimator", "trial", axis)
    for _, block in blocks(dataset):
        per = max(1, math.prod(block.sizes[dim] for dim in rows if dim != "trial"))
        step = max(1, _ROWS // per)
        for begin in range(0, block.sizes["trial"], step):
            yield _one_table(block.isel(trial=slice(begin, begin + step)).load(), rows)


def _order(name: str) -> tuple[int, str]:
    return _FIRST.index(name) if name in _FIRST else len(_FIRST), name


def _one_table(block: xr.Dataset, rows: tuple[str, ...]) -> pa.Table:
    shape = [block.sizes[dim] for dim in rows]
    columns: dict[str, Any] = {}

    def put(name: str, values: xr.DataArray) -> None:
        missing = [dim for dim in rows if dim not in values.dims]
        whole = values.expand_dims({dim: block.sizes[dim] for dim in missing}).transpose(*rows)
        flat = np.broadcast_to(whole.values, shape).reshape(-1)
        columns[name] = pa.array(flat, from_pandas=flat.dtype.kind == "f")

    for dim in rows:
        if dim in block.coords and dim != "epoch":
            put("time_s" if dim == "time" else dim, block[dim])
    if "epoch" in rows:
        put("epoch", xr.DataArray(np.arange(block.sizes["epoch"]), dims="epoch"))
        put("time_s", block["time"])
    for name in ("track", "measured_rows"):
        if name in block.coords:
            put(name, block[name])
    for name in sorted(map(str, block.data_vars), key=_order):
        variable = block[name]
        inner = [str(dim) for dim in variable.dims if dim not in rows]
        for place in product(*(range(block.sizes[dim]) for dim in inner)):
            where = dict(zip(inner, place, strict=True))
            labels = [str(block[dim].values[k]) if dim in block.coords else str(k) for dim, k in where.items()]
            put("_".join([name, *labels]), variable.isel(where))
    if "estimate" in block:
        for what, values in errors(block).items():
            put(f"{what}_error_{UNITS[str(what)].replace('/', 'p')}", values)
    return pa.table(columns)
