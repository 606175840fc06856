"""Places in a plane, one or more of each target and method, as tables and on the map."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.readers.gpx import GpxTrack
from quietfix.diagrams.writers.estimates import Columns, write_estimates
from quietfix.diagrams.writers.geojson import EstimatedTrack, geojson_text
from quietfix.diagrams.writers.gpx import gpx_text

__all__ = ["PlaneTrack", "plane_columns", "write_plane"]

Array = NDArray[np.float64]

_POINTS = 2000  # in GeoJSON: each has two ellipses
_AXES = {True: ("east", "north", "veast", "vnorth"), False: ("x", "y", "vx", "vy")}


class PlaneTrack(NamedTuple):
    """What a method says of a target.

    Attributes
    ----------
    estimator, target : str
    time : ndarray, shape (k,)
        [s]
    state : ndarray, shape (k, 2 or 4)
        East and north, and their rates where it moves [m, m/s].
    covariance : ndarray, shape (k, n, n)
    degrees : (ndarray, ndarray), optional
        Latitude and longitude (k,) [deg]; None: nobody knows where the origin is.
    """

    estimator: str
    target: str
    time: Array
    state: Array
    covariance: Array
    degrees: tuple[Array, Array] | None


def plane_columns(tracks: Sequence[PlaneTrack]) -> Columns:
    """Return the columns of a table of estimates; all tracks have as many states, and places or none."""
    geodetic = all(track.degrees is not None for track in tracks)
    states, names = tracks[0].state.shape[1], _AXES[geodetic]
    count = [track.time.size for track in tracks]
    state, covariance = (np.concatenate([getattr(track, name) for track in tracks]) for name in ("state", "covariance"))
    columns: Columns = {
        "estimator": [track.estimator for track, k in zip(tracks, count, strict=True) for _ in range(k)],
        "target": [track.target for track, k in zip(tracks, count, strict=True) for _ in range(k)],
        "time_s": np.concatenate([track.time for track in tracks]),
    }
    if geodetic:
        for i, name in enumerate(("latitude_deg", "longitude_deg")):
            columns[name] = np.concatenate([track.degrees[i] for track in tracks if track.degrees is not None])
    else:
        columns |= {"x_m": state[:, 0], "y_m": state[:, 1]}
    columns |= {f"{names[i]}_mps": state[:, i] for i in range(2, states)}
    for i in range(states):
        columns |= {f"cov_{names[i]}_{names[j]}": covariance[:, i, j] for j in range(i, states)}
    return columns


def write_plane(tracks: Sequence[PlaneTrack], folder: Path) -> list[Path]:
    """Write ``estimates.csv`` and ``.parquet`` and, where places on the Earth are known, GeoJSON and GPX."""
    tracks = [track for track in tracks if track.time.size]
    if not tracks:
        return []
    written = write_estimates(plane_columns(tracks), folder)
    if any(track.degrees is None for track in tracks):
        return written
    shown, lines = [], []
    for track in tracks:
        assert track.degrees is not None
        latitude, longitude = track.degrees
        nothing = np.full(track.time.size, np.nan)
        spread = np.full((track.time.size, 3, 3), np.nan)
        spread[:, :2, :2] = track.covariance[:, :2, :2]
        name, zeros = f"{track.target} {track.estimator}", np.zeros(track.time.size, dtype=np.int64)
        shown.append(EstimatedTrack(name, None, track.time, latitude, longitude, nothing, spread))
        around = np.mod(longitude + 180.0, 360.0) - 180.0
        lines.append(GpxTrack(name, zeros, track.time, latitude, around, nothing, nothing, zeros))
    every = max(1, sum(track.time.size for track in tracks) // _POINTS)
    texts = {"estimates.geojson": geojson_text(shown, every), "estimates.gpx": gpx_text(lines, dated=False)}
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return [*written, *(folder / name for name in texts)]
