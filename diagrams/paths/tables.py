"""Paths from tables of platforms."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path as FilePath

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.paths.movers import Platform
from quietfix.diagrams.paths.records import Setting, file_of, of_field, recorded_path, stamp_of
from quietfix.diagrams.quantities.frame import EARTH_FIXED, INERTIAL, Frame
from quietfix.diagrams.readers.platforms import PlatformRows, PlatformTable, read_platforms
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.systems.earth.geodetic import geodetic_to_ecef

__all__ = ["doubtful_table", "platform_path", "stands"]

Array = NDArray[np.float64]
Path = Callable[[float], Array]


@lru_cache(maxsize=32)
def _table(path: FilePath, stamp: tuple[int, int]) -> PlatformTable:
    """Read a file once for all platforms and diagrams of a run; `stamp` tells another version of it."""
    return read_platforms(path)


def doubtful_table(field: Platform, setting: Setting, where: str) -> str:
    """Return what is doubtful in a platform's table; empty: nothing.

    Raises
    ------
    UserError
        If the file cannot be read.
    """
    path = file_of(field.file, setting, where)
    with of_field(where):
        return " ".join(_table(path, stamp_of(path, where)).notes)


def _rows(field: Platform, setting: Setting, where: str) -> tuple[str, PlatformRows]:
    """Return what a platform's table is called in messages, and the platform's rows."""
    path = file_of(field.file, setting, where)
    with of_field(where):
        table = _table(path, stamp_of(path, where)).platforms
    what = f"{where}.file: {path.name}"
    if not field.name and len(table) == 1:
        rows = next(iter(table.values()))
    else:
        rows = table[choose(f"{where}.name", field.name, table)]
    return what, rows


def stands(field: Platform, setting: Setting, where: str) -> bool:
    """Return whether a platform of a table stands where it is.

    Raises
    ------
    UserError
        If the file cannot be read or has no such platform.
    """
    return _rows(field, setting, where)[1].rest is None


def platform_path(field: Platform, setting: Setting, frame: Frame, where: str) -> tuple[Path, Frame | None]:
    """Return the state of a platform of a table as a function of time, and its axes; None: those of the system.

    Raises
    ------
    UserError
        If the file cannot be read or has no such platform, for latitudes in a flat frame, and for a record that does
        not cover the run.
    """
    what, rows = _rows(field, setting, where)
    if rows.geodetic and frame.flat:
        raise UserError(f"{what}: latitude_deg is not allowed in frame {frame.name}; x_m, y_m, z_m")
    places = rows.places
    if rows.geodetic:
        places = geodetic_to_ecef(np.radians(places[:, 0]), np.radians(places[:, 1]), places[:, 2])
    axes = EARTH_FIXED if rows.geodetic else None
    if rows.rest is None:
        state = np.concatenate([places[0], np.zeros(3)])
        if axes is None and frame is INERTIAL:
            raise UserError(f"{what}: line {rows.line}: x, y, z of what stands are not allowed in frame {frame.name}")
        return lambda t: state, axes
    states = places if rows.velocities is None else np.concatenate([places, rows.velocities], axis=1)
    return recorded_path(_times(rows, setting), states, setting, f"{what}: {rows.name}"), axes


def _times(rows: PlatformRows, setting: Setting) -> Array:
    """Return seconds since t = 0."""
    assert rows.rest is not None
    if rows.second is None:
        return rows.rest
    began = setting.began()
    zero = (int(rows.second[0]), float(rows.rest[0])) if began is None else began
    return (rows.second - zero[0]) + (rows.rest - zero[1])
