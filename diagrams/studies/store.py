"""The Zarr store of a result: written chunk by chunk at their places, and opened without running anything."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import xarray as xr
import zarr

from quietfix.diagrams.schema.errors import UserError

__all__ = ["add", "check_store", "consolidate", "cut", "files_of", "read_attributes", "write"]

_LARGEST = 1 << 27  # bytes of a chunk of an array
_CODECS = ("bytes", "zstd", "blosc", "gzip", "crc32c", "transpose", "sharding_indexed", "vlen-utf8")
"""Standard Zarr 3 codecs; none of them can hold an object, a pickle or a name of a class."""
_TYPES = ("bool", "fixed_length_utf32", "string", *(f"{k}{b}" for k in ("int", "uint") for b in (8, 16, 32, 64)))
_TYPES += ("float16", "float32", "float64", "complex64", "complex128")


def write(store: Path, chunk: xr.Dataset, along: str, begin: int, size: int, width: int) -> None:
    """Write one chunk at its place; the first one that is written, whichever it is, also makes the store.

    Parameters
    ----------
    store : Path
    chunk : xarray.Dataset
        Variables without the dimension `along` are the same in all chunks, and those of the first are written.
    along : str
        What the result is cut along.
    begin : int
        Where the chunk begins.
    size : int
        How long the whole result is, as far as is known: a store that is shorter grows.
    width : int
        How long a chunk is: those of the store's arrays are the same, so that no two chunks write one file.
    """
    with warnings.catch_warnings():
        # zarr warns that its text type is not in the v3 specification yet; xarray reads it all the same.
        warnings.simplefilter("ignore")
        if not (store / "zarr.json").exists():
            _create(store, chunk, along, width)
        group = zarr.open_group(store, mode="r+", use_consolidated=False)
        _grow(group, along, size)
        rows = chunk[[name for name in chunk if along in chunk[name].dims]]
        rows = rows.drop_vars([c for c in rows.coords if along not in rows[c].dims])
        place = slice(begin, begin + chunk.sizes[along])
        rows.to_zarr(store, region={along: place}, consolidated=False)
        if along in rows.coords:  # xarray leaves the index out of a region
            index: Any = group[along]
            index[place] = rows[along].values
        if fresh := _fresh(chunk, along):
            chunk[fresh].to_zarr(store, mode="a", consolidated=False)


def add(store: Path, variables: xr.Dataset) -> None:
    """Write variables that are no chunk's, in place of those that are there."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        group = zarr.open_group(store, mode="r+", use_consolidated=False)
        for name in map(str, variables):  # a kill may have left some of them, in part
            if name in group:
                del group[name]
        variables.drop_vars(list(variables.coords)).to_zarr(store, mode="a", consolidated=False)


def _create(store: Path, chunk: xr.Dataset, along: str, width: int) -> None:
    """Make a store of no length, with all that is no chunk's."""
    empty = chunk.isel({along: slice(0)})
    empty = empty.drop_vars(_fresh(chunk, along))
    shapes = {
        str(name): {"chunks": tuple(_lengths(variable, along, width))}
        for name, variable in empty.variables.items()
        if along in variable.dims
    }
    empty.to_zarr(store, mode="w", encoding=shapes, consolidated=False)


def _lengths(variable: xr.Variable, along: str, width: int) -> list[int]:
    """Return the shape of the chunks of an array on disk: so many along one dimension, and all along the others."""
    lengths = [width if dim == along else max(1, length) for dim, length in variable.sizes.items()]
    for axis, dim in enumerate(variable.dims):  # what is compressed at once must have less than 2 GB
        if dim != along and math.prod(lengths) * variable.dtype.itemsize > _LARGEST:
            lengths[axis] = 1
    return lengths


def _grow(group: zarr.Group, along: str, size: int) -> None:
    for _, array in group.arrays():
        axis = _axis(array, along)
        if axis is not None and array.shape[axis] < size:
            array.resize((*array.shape[:axis], size, *array.shape[axis + 1 :]))


def _axis(array: Any, along: str) -> int | None:
    """Return which axis of an array has a name."""
    dimensions = getattr(array.metadata, "dimension_names", None) or ()
    return dimensions.index(along) if along in dimensions else None


def files_of(store: Path, along: str, begin: int, end: int) -> Iterator[str]:
    """Yield the names of the files that hold what lies between two places; one that holds nothing may be missing."""
    group = zarr.open_group(store, mode="r", use_consolidated=False)
    for name, array in sorted(group.arrays()):
        axis = _axis(array, along)
        if axis is None:
            continue
        spans = [range(-(-length // step)) for length, step in zip(array.shape, array.chunks, strict=True)]
        step = array.chunks[axis]
        spans[axis] = range(begin // step, -(-end // step))
        yield from ("/".join([name, "c", *map(str, place)]) for place in product(*spans))


def consolidate(store: Path) -> None:
    """Write the metadata of all arrays into the store's own, where xarray looks for them first."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # zarr: they are not in the specification of Zarr 3 yet
        zarr.consolidate_metadata(store)


def _fresh(chunk: xr.Dataset, along: str) -> list[str]:
    """Return what only the last chunk brings: bounds."""
    return [str(name) for name in chunk if str(name).startswith("bound_") and along not in chunk[name].dims]


def cut(store: Path, chunk: xr.Dataset, along: str, size: int) -> None:
    """Take a chunk that was written in part back out of the store, to `size` along its dimension."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        group = zarr.open_group(store, mode="r+", use_consolidated=False)
        fresh = _fresh(chunk, along)
        for name, array in list(group.arrays()):
            axis = _axis(array, along)
            if name in fresh:
                del group[name]
            elif axis is not None and array.shape[axis] > size:
                array.resize((*array.shape[:axis], size, *array.shape[axis + 1 :]))


# ----------------------------------------------------------------------------------------------------------- reading


def read_attributes(store: Path) -> dict[str, Any]:
    """Return the attributes of a store's group; nothing but JSON is read.

    Raises
    ------
    UserError
        If it is not a Zarr 3 group.
    """
    content = _metadata(store / "zarr.json")
    if content.get("zarr_format") != 3 or content.get("node_type") != "group":
        raise UserError(f"result: {store} is not a group of Zarr 3, as results are")
    attributes = content.get("attributes", {})
    if not isinstance(attributes, dict):
        raise UserError(f"result: {store} has attributes that are not a mapping")
    return attributes


def check_store(store: Path) -> None:
    """Refuse a store that is not plain Zarr 3 arrays: a codec that unpickles would run what a file says.

    Raises
    ------
    UserError
        Naming the array and the codec or data type that is not allowed.
    """
    read_attributes(store)
    for path in sorted(store.iterdir()):
        if not path.is_dir():
            continue
        content = _metadata(path / "zarr.json")
        where = f"result: {path}"
        if content.get("zarr_format") != 3 or content.get("node_type") != "array":
            raise UserError(f"{where} is not an array of Zarr 3, as those of results are")
        kind = _name(content.get("data_type"))
        if kind not in _TYPES:
            raise UserError(f"{where}: the data type {kind} is not allowed; {', '.join(_TYPES)}")
        if content.get("storage_transformers"):
            raise UserError(f"{where}: storage transformers are not allowed")
        _check_codecs(where, content.get("codecs"))


def _check_codecs(where: str, codecs: Any) -> None:
    if not isinstance(codecs, list):
        raise UserError(f"{where}: it has no list of codecs")
    for codec in codecs:
        name = _name(codec)
        if name not in _CODECS:
            raise UserError(f"{where}: the codec {name} is not allowed; {', '.join(_CODECS)}")
        options = codec.get("configuration") if isinstance(codec, dict) else None
        for inner in ("codecs", "index_codecs"):  # of sharding
            if isinstance(options, dict) and inner in options:
                _check_codecs(where, options[inner])


def _name(entry: Any) -> str:
    return str(entry.get("name") if isinstance(entry, dict) else entry)


def _metadata(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise UserError(f"result: {path} cannot be read ({reason})") from error
    if not isinstance(content, dict):
        raise UserError(f"result: {path} cannot be read (it holds no mapping)")
    return content
