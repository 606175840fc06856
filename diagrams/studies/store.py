"""The Zarr store of a result: growing by chunks, cut back where a chunk failed, and opened without running anything."""

from __future__ import annotations

import json
import warnings
from pathlib import Path
from typing import Any

import xarray as xr
import zarr

from quietfix.diagrams.schema.errors import UserError

__all__ = ["append", "check_store", "consolidate", "cut", "read_attributes"]

_CODECS = ("bytes", "zstd", "blosc", "gzip", "crc32c", "transpose", "sharding_indexed", "vlen-utf8")
"""Standard Zarr 3 codecs; none of them can hold an object, a pickle or a name of a class."""
_TYPES = ("bool", "fixed_length_utf32", "string", *(f"{k}{b}" for k in ("int", "uint") for b in (8, 16, 32, 64)))
_TYPES += ("float16", "float32", "float64", "complex64", "complex128")


def append(store: Path, chunk: xr.Dataset, along: str, first: bool) -> None:
    """Write one chunk behind those that are there; variables without that dimension are written when they are new."""
    with warnings.catch_warnings():
        # zarr warns that its text type is not in the v3 specification yet; xarray reads it all the same.
        warnings.simplefilter("ignore")
        if first:
            chunk.to_zarr(store, mode="w", consolidated=False)
            return
        grows = chunk[[name for name in chunk if along in chunk[name].dims]]
        grows.drop_vars([c for c in grows.coords if along not in grows[c].dims]).to_zarr(
            store, append_dim=along, consolidated=False
        )
        fresh = _fresh(chunk, along)
        if fresh:
            chunk[fresh].to_zarr(store, mode="a", consolidated=False)


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
            dimensions = getattr(array.metadata, "dimension_names", None) or ()
            if name in fresh:
                del group[name]
            elif along in dimensions:
                axis = dimensions.index(along)
                if array.shape[axis] > size:
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
