"""Paths from the tracks of satellite navigation receivers."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path as FilePath

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.paths.movers import Gpx
from quietfix.diagrams.paths.records import Setting, file_of, of_field, recorded_path, stamp_of
from quietfix.diagrams.readers.gpx import GpxTrack, read_gpx
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.geodetic import geodetic_to_ecef

__all__ = ["doubtful_heights", "gpx_path"]

Array = NDArray[np.float64]
Path = Callable[[float], Array]


def gpx_path(field: Gpx, setting: Setting, where: str) -> Path:
    """Return a track of a GPX file as an Earth-fixed state as a function of time.

    Raises
    ------
    UserError
        If the file cannot be read, has no such track or points without a height, or does not cover the run without a
        gap between segments.
    """
    track, what = _read(field, setting, where)
    missing = np.flatnonzero(np.isnan(track.elevation))
    if missing.size and field.height_m is None:
        raise UserError(f"{what}: {missing.size} points have no <ele>; height_m says how high they are")
    geoid = np.where(np.isnan(track.geoid), field.geoid_m, track.geoid)
    height = track.elevation + geoid if field.height_m is None else np.full(track.rest.size, field.height_m)
    places = geodetic_to_ecef(np.radians(track.latitude), np.radians(track.longitude), height)
    began = setting.began()
    zero = (int(track.second[0]), float(track.rest[0])) if began is None else began
    times = (track.second - zero[0]) + (track.rest - zero[1])
    return recorded_path(*_with_gaps(times, places, track.part), setting, what)


def doubtful_heights(field: Gpx, setting: Setting, where: str) -> str:
    """Return that heights above the geoid are taken for heights above the ellipsoid; empty: they are not."""
    if field.height_m is not None or field.geoid_m:
        return ""
    track, what = _read(field, setting, where)
    missing = int(np.count_nonzero(np.isnan(track.geoid)))
    if not missing:
        return ""
    return (
        f"{what}: <ele> is above the geoid, and taken as above the ellipsoid at {missing} points without "
        f"<geoidheight>: off by -107 to 86 m, {where}.geoid_m says by how much."
    )


def _read(field: Gpx, setting: Setting, where: str) -> tuple[GpxTrack, str]:
    """Return the track, and what messages call it."""
    path = file_of(field.file, setting, where)
    what = f"{where}.file: {path.name}"
    with of_field(where):
        tracks = _tracks(path, stamp_of(path, where))
    return _track(field, tracks, what), what


@lru_cache(maxsize=8)
def _tracks(path: FilePath, stamp: tuple[int, int]) -> list[GpxTrack]:
    """Read a file once for all that a command makes of it; `stamp` tells another version of it."""
    return read_gpx(path)


def _track(field: Gpx, tracks: list[GpxTrack], what: str) -> GpxTrack:
    """Return the track of that name."""
    named = [track for track in tracks if not field.track or track.name == field.track]
    if len(named) != 1:
        there = ", ".join(repr(track.name) for track in tracks[:20])
        asked = f"track {field.track!r}" if field.track else "no track"
        raise UserError(f"{what}: {asked} is not allowed; one of {there}, and the only one of its name")
    return named[0]


def _with_gaps(times: Array, places: Array, part: NDArray[np.int64]) -> tuple[Array, Array]:
    """Put a NaN between segments."""
    at = np.flatnonzero(np.diff(part)) + 1
    middles = 0.5 * (times[at] + times[at - 1])
    return np.insert(times, at, middles), np.insert(places, at, np.nan, axis=0)
