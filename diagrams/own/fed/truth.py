"""Where the targets of measurements of one's own were, as far as anybody knows."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path as FilePath

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.paths.functions import Path
from quietfix.diagrams.paths.records import Setting
from quietfix.diagrams.quantities.frame import Frame
from quietfix.diagrams.readers.measurements import numbers_of, texts_of, times_of
from quietfix.diagrams.readers.rows import Chunk, broken, chunks_of
from quietfix.systems.earth.geodetic import geodetic_to_ecef
from quietfix.systems.plants.recorded import RecordedTruth, hermite

__all__ = ["read_truth"]

Array = NDArray[np.float64]

_PLACES = (("x_m", "y_m", "z_m"), ("latitude_deg", "longitude_deg", "height_m"))
_VELOCITY = ("vx_mps", "vy_mps", "vz_mps")
_WORDS = (
    "time (with its zone) or time_s, x_m, y_m, z_m (and vx_mps, vy_mps, vz_mps) or latitude_deg, longitude_deg, "
    "height_m; of several targets target"
)


def read_truth(path: FilePath, setting: Setting, frame: Frame) -> dict[str, Path]:
    """Return the states of targets as functions of time, NaN where their tracks do not reach.

    Parameters
    ----------
    path : Path
        CSV with any delimiter, or Parquet; one row of a target: it stands there.
    setting : Setting
        For t = 0 of a track with dates.
    frame : Frame
        The system's, whose axes x_m, y_m, z_m are in.

    Returns
    -------
    dict of str to callable
        By the names of targets; without the column ``target`` under the empty one.

    Raises
    ------
    UserError
        In one line with file and line.
    """
    chunks = list(chunks_of(path, _known, _WORDS))
    lines = np.concatenate([np.asarray(chunk.lines, dtype=np.int64) for chunk in chunks])
    if not lines.size:
        raise broken(path, None, "it has no rows; at least one place")
    times = np.concatenate([_seconds(path, chunk, setting) for chunk in chunks])
    states = np.concatenate([_states(path, chunk, frame) for chunk in chunks])
    names = [name for chunk in chunks for name in texts_of(chunk.columns.get("target", [""] * len(chunk.lines)))]
    found = {}
    of = np.array(names)
    for name in dict.fromkeys(names):
        mine = np.flatnonzero(of == name)
        mine = mine[np.argsort(times[mine], kind="stable")]
        for k in np.flatnonzero(np.diff(times[mine]) <= 0)[:1]:
            raise broken(path, int(lines[mine[k + 1]]), f"{name or 'the target'} is there twice at one time")
        found[name] = _path(times[mine], states[mine])
    return found


def _known(names: Sequence[str]) -> bool:
    return bool({"time", "time_s"} & set(names)) and any(set(place) <= set(names) for place in _PLACES)


def _seconds(path: FilePath, chunk: Chunk, setting: Setting) -> Array:
    """Return times since t = 0."""
    whole, rest = times_of(path, chunk)
    if whole is None:
        return rest
    began = setting.began()
    if began is None:
        raise broken(path, None, "time: dates are not allowed without start_utc or dates in the measurements; time_s")
    return (whole - began[0]) + (rest - began[1])


def _states(path: FilePath, chunk: Chunk, frame: Frame) -> Array:
    """Return positions (rows, 3), with velocities where there are some (rows, 6), in the axes of the frame."""
    names = chunk.columns

    def columns(wanted: Sequence[str]) -> Array:
        return np.stack([numbers_of(path, chunk, name) for name in wanted], axis=1)

    if set(_PLACES[0]) <= set(names):
        return columns([*_PLACES[0], *(_VELOCITY if set(_VELOCITY) <= set(names) else ())])
    if not frame.geodetic:
        raise broken(path, None, f"latitude_deg is not allowed in frame {frame.name}; x_m, y_m, z_m")
    latitude, longitude, height = columns(_PLACES[1]).T
    for i in np.flatnonzero(np.abs(latitude) > 90)[:1]:
        raise broken(path, chunk.lines[i], f"latitude_deg: {latitude[i]:g} is not allowed; -90 to 90")
    return geodetic_to_ecef(np.radians(latitude), np.radians(longitude), height)


def _path(times: Array, states: Array) -> Path:
    if len(times) == 1:
        place = np.concatenate([states[0, :3], np.zeros(3)])
        return lambda t: place
    truth = RecordedTruth(times, states, name="truth")
    return partial(_at, truth.times, truth.states[:, 0])


def _at(times: Array, states: Array, time: float) -> Array:
    return hermite(times, states, time)[0]
