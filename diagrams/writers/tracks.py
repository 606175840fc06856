"""Estimates as tracks on the Earth, in every format that there is: the one place that lists them."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.quantities.frame import frame_of
from quietfix.diagrams.quantities.states import POSITION, VELOCITY
from quietfix.diagrams.readers.ccsds.oem import EphemerisMessage, EphemerisSegment
from quietfix.diagrams.readers.ccsds.oem_covariance import Covariance
from quietfix.diagrams.readers.gpx import GpxTrack
from quietfix.diagrams.statistics.epochs import along
from quietfix.diagrams.writers.geojson import EstimatedTrack, geojson_text, horizontal
from quietfix.diagrams.writers.gpx import gpx_text
from quietfix.diagrams.writers.oem import oem_text
from quietfix.systems.earth.geodetic import ecef_to_geodetic
from quietfix.systems.earth.time_scales import from_tai

__all__ = ["MOST_ORBITS", "write_tracks"]

Array = NDArray[np.float64]

_POINTS = 2000  # of all tracks in GeoJSON: each has two ellipses, 10 kB
MOST_ORBITS = 20
"""So many tracks have a file of an orbit, the first ones."""

_KM = 1e-3


@dataclass(frozen=True, eq=False)
class _Track:
    """Estimates of one target by one estimator where there is one, Earth-fixed; NaN velocities where it has none.

    Without dates `second` is None, and `rest` the time in seconds.
    """

    target: str
    estimator: str
    second: NDArray[np.int64] | None
    rest: Array
    state: Array
    covariance: Array
    nis: Array

    @property
    def name(self) -> str:
        return f"{self.target} {self.estimator}"

    @property
    def place(self) -> tuple[Array, Array, Array]:
        """Latitude, longitude [deg] and height [m]."""
        latitude, longitude, height = ecef_to_geodetic(self.state[:, :3])
        return np.degrees(latitude), np.degrees(longitude), height


def write_tracks(dataset: xr.Dataset, began: tuple[int, float] | None, folder: Path) -> list[Path]:
    """Write estimates as GeoJSON, GPX and, of states with a velocity, orbit ephemeris messages.

    Nothing is written of places that are not on the Earth. Without a date GeoJSON has ``time_s``, GPX no times, and
    there are no ephemeris messages.

    Parameters
    ----------
    dataset : xarray.Dataset
        Result of a study with ``track`` (trial) that kept covariances.
    began : (int, float), optional
        t = 0 in seconds of TAI since 1970, whole ones and the rest.
    folder : Path
    """
    if not frame_of(dataset).geodetic or not set(POSITION) <= {*dataset["state"].values}:
        return []
    tracks = [track for track in _tracks(dataset, began) if track.rest.size]
    written = []
    for write in _FORMATS:
        for name, text in write(tracks) if tracks else ():
            path = folder / name
            path.write_text(text, encoding="utf-8")
            written.append(path)
    return written


def _tracks(dataset: xr.Dataset, began: tuple[int, float] | None) -> Iterator[_Track]:
    axis, names = along(dataset), [str(name) for name in dataset["state"].values]
    places = [names.index(name) if name in names else -1 for name in (*POSITION, *VELOCITY)]
    has = [i for i, place in enumerate(places) if place >= 0]
    time = np.broadcast_to(dataset["time"].values, (dataset.sizes["trial"], dataset.sizes[axis]))
    for k, target in enumerate(dataset["track"].values):
        for name in dataset["estimator"].values:
            one = dataset.sel(estimator=name).isel(trial=k)
            estimate = one["estimate"].transpose(axis, "state").values
            known = np.isfinite(time[k]) & np.isfinite(estimate[:, places[:3]]).all(axis=-1)
            second, rest = _moments(time[k, known], began)
            state = np.full((int(known.sum()), 6), np.nan)
            state[:, has] = estimate[known][:, [places[i] for i in has]]
            covariance = np.full((len(state), 6, 6), np.nan)
            kept = np.array([places[i] for i in has])
            covariance[:, np.array(has)[:, None], has] = one["covariance"].values[known][:, kept[:, None], kept]
            yield _Track(
                str(target),
                str(name),
                second,
                rest,
                state,
                covariance,
                one["nis"].values[known].astype(float),
            )


def _moments(time: Array, began: tuple[int, float] | None) -> tuple[NDArray[np.int64] | None, Array]:
    """Return whole seconds of TAI since 1970 and rests; without a date None and the times themselves."""
    if began is None:
        return None, time
    whole = np.floor(time)
    rest = began[1] + (time - whole)
    carried = np.floor(rest)
    return began[0] + (whole + carried).astype(np.int64), rest - carried


def _geojson(tracks: Sequence[_Track]) -> Iterator[tuple[str, str]]:
    every = max(1, sum(track.rest.size for track in tracks) // _POINTS)
    shown = []
    for track in tracks:
        latitude, longitude, height = track.place
        spread = horizontal(track.covariance[:, :3, :3], latitude, longitude)
        shown.append(
            EstimatedTrack(track.name, track.second, track.rest, latitude, longitude, height, spread, track.nis)
        )
    yield "estimates.geojson", geojson_text(shown, every)


def _gpx(tracks: Sequence[_Track]) -> Iterator[tuple[str, str]]:
    shown = []
    for track in tracks:
        latitude, longitude, height = track.place
        unknown, part = np.full(height.size, np.nan), np.zeros(height.size, dtype=np.int64)
        name = f"{track.name} (heights above the ellipsoid of WGS 84)"
        second = np.zeros(height.size, dtype=np.int64) if track.second is None else track.second
        shown.append(GpxTrack(name, second, track.rest, latitude, longitude, height, unknown, part))
    yield "estimates.gpx", gpx_text(shown, dated=all(track.second is not None for track in tracks))


def _oem(tracks: Sequence[_Track]) -> Iterator[tuple[str, str]]:
    created = f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%S}"
    for track in tracks[:MOST_ORBITS]:
        second = track.second
        if second is None or not np.isfinite(track.state).all():
            continue
        stamps = [from_tai(int(second[i]), float(track.rest[i])) for i in (0, -1)]
        name = re.sub(r"[^\w+-]+", "-", track.name)
        metadata = {
            "OBJECT_NAME": track.target,
            "OBJECT_ID": track.target,
            "CENTER_NAME": "EARTH",
            "REF_FRAME": "ITRF2000",
            "TIME_SYSTEM": "UTC",
            "START_TIME": stamps[0],
            "STOP_TIME": stamps[1],
        }
        told = np.isfinite(track.covariance).all(axis=(-1, -2))
        spreads = tuple(
            Covariance(int(second[i]), float(track.rest[i]), "", _KM**2 * track.covariance[i])
            for i in np.flatnonzero(told)
        )
        states, nothing = _KM * track.state, np.full((second.size, 3), np.nan)
        segment = EphemerisSegment(
            metadata, second, track.rest, states, nothing, spreads, (f"estimated by {track.estimator}",)
        )
        header = {"CREATION_DATE": created, "ORIGINATOR": "QUIETFIX"}
        yield f"estimates_{name}.oem", oem_text(EphemerisMessage(header, (segment,)))


_FORMATS: Sequence[Callable[[Sequence[_Track]], Iterator[tuple[str, str]]]] = (_geojson, _gpx, _oem)
"""Each yields names of files and what is in them; a new format is a function here."""
