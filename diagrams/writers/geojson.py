"""Tracks and error ellipses as GeoJSON (RFC 7946)."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.writers.ellipse import ellipse_ring
from quietfix.diagrams.writers.meridian import cut_line, cut_ring
from quietfix.systems.earth.geodetic import enu_rotation
from quietfix.systems.earth.time_scales import from_tai

__all__ = ["EstimatedTrack", "geojson_text", "horizontal"]

Array = NDArray[np.float64]

_SIZES = {"1 sigma": 1.0, "95 %": math.sqrt(-2.0 * math.log(0.05))}
_DIGITS = 9  # of a degree: 0.1 mm
_MILLIMETRES = 4


@dataclass(frozen=True, eq=False)
class EstimatedTrack:
    """Estimates of a target; rows whose position is not finite are left out, and the line is broken there.

    Attributes
    ----------
    name : str
        Of the target or the estimator.
    second : ndarray of int, shape (k,), or None
        Whole seconds of TAI since 1970; see `quietfix.systems.earth.time_scales`. None: there are no dates.
    rest : ndarray, shape (k,)
        And the rest [s]; without dates all of the time.
    latitude, longitude : ndarray, shape (k,)
        On WGS 84 [deg].
    height : ndarray, shape (k,)
        Above the ellipsoid [m].
    covariance : ndarray, shape (k, 3, 3), optional
        Of the position in axes east, north, up [m^2]; a NaN: no ellipse. `horizontal` of Earth-fixed ones.
    nis : ndarray, shape (k,), optional
        Normalised innovation squared of each epoch; NaN: none.
    """

    name: str
    second: NDArray[np.int64] | None
    rest: Array
    latitude: Array
    longitude: Array
    height: Array
    covariance: Array | None = None
    nis: Array | None = None


def horizontal(covariance: Array, latitude: Array, longitude: Array) -> Array:
    r"""Return Earth-fixed covariances (k, 3, 3) of positions in axes east, north and up.

    :math:`P_{ENU} = R\,P\,R^T` with the rows of R east, north and up at the place; its upper left block is that of the
    horizontal error.

    Parameters
    ----------
    covariance : ndarray, shape (k, 3, 3)
        [m^2]
    latitude, longitude : ndarray, shape (k,)
        [deg]
    """
    turn = enu_rotation(np.radians(latitude), np.radians(longitude))
    return turn @ covariance @ np.swapaxes(turn, -1, -2)


def geojson_text(tracks: Sequence[EstimatedTrack], every: int = 1, about: Mapping[str, Any] | None = None) -> str:
    """Return a FeatureCollection: of each track a line, its points, and their ellipses of 1 sigma and 95 %.

    An ellipse of k sigma holds the target in :math:`1 - e^{-k^2/2}` of all cases if the error is normal: that of 1
    sigma in 39 %, that of 95 % is of 2.45 sigma.

    Parameters
    ----------
    tracks : sequence of EstimatedTrack
    every : int
        Points and ellipses are of every so many rows; the line is of all.
    about : mapping, optional
        Members of the collection's own (RFC 7946, section 6.1).

    Raises
    ------
    ValueError
        For a latitude beyond the poles, and a covariance that is none: a variance that is negative.
    """
    if every < 1:
        raise ValueError(f"every: {every} is not allowed; at least 1")
    features = [feature for track in tracks for feature in _features(track, every)]
    found = {"type": "FeatureCollection", **(about or {}), "features": features}
    return json.dumps(found, allow_nan=False, ensure_ascii=False, separators=(",", ":")) + "\n"


def _features(track: EstimatedTrack, every: int) -> list[dict[str, Any]]:
    place = np.stack([track.longitude, track.latitude, track.height], axis=-1)
    known = np.isfinite(place[:, :2]).all(axis=-1)
    if np.any(np.abs(place[known, 1]) > 90):
        raise ValueError(f"{track.name}: a latitude beyond 90 degrees is not allowed")
    place[:, 0] = np.where(np.abs(place[:, 0]) <= 180, place[:, 0], np.mod(place[:, 0] + 180.0, 360.0) - 180.0)
    found = []
    stretches = np.split(place, np.flatnonzero(~known))
    lines = [line for stretch in stretches for line in cut_line(stretch[np.isfinite(stretch[:, :2]).all(axis=-1)])]
    if lines:
        found.append(_feature(_line(lines), {"name": track.name, "kind": "track"}))
    for row in np.flatnonzero(known)[::every]:
        properties = _properties(track, int(row))
        found.append(_feature({"type": "Point", "coordinates": _position(place[row])}, properties))
        found += _ellipses(track, int(row))
    return found


def _feature(geometry: Mapping[str, Any], properties: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _position(place: Array) -> list[float]:
    """Return longitude, latitude and, where it is known, height."""
    found = [round(float(one), _DIGITS) for one in place[:2]]
    return [*found, round(float(place[2]), _MILLIMETRES)] if place.size > 2 and math.isfinite(place[2]) else found


def _line(lines: Sequence[Array]) -> dict[str, Any]:
    coordinates = [[_position(one) for one in line] for line in lines]
    if len(coordinates) == 1:
        return {"type": "LineString", "coordinates": coordinates[0]}
    return {"type": "MultiLineString", "coordinates": coordinates}


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _moment(track: EstimatedTrack, row: int) -> dict[str, Any]:
    if track.second is None:
        return {"time_s": float(track.rest[row])}
    return {"time": f"{from_tai(int(track.second[row]), float(track.rest[row]))}Z"}


def _properties(track: EstimatedTrack, row: int) -> dict[str, Any]:
    found: dict[str, Any] = {"name": track.name, "kind": "estimate", **_moment(track, row)}
    found["height_m"] = _number(track.height[row])
    if track.covariance is not None:
        variances = np.diagonal(track.covariance[row])
        if np.any(variances < 0):
            raise ValueError(f"{track.name}, row {row}: a variance of {variances.min():g} m^2 is not allowed; >= 0")
        for axis, variance in zip(("east", "north", "up"), variances, strict=True):
            found[f"sigma_{axis}_m"] = _number(math.sqrt(variance)) if math.isfinite(variance) else None
    if track.nis is not None:
        found["nis"] = _number(track.nis[row])
    return found


def _ellipses(track: EstimatedTrack, row: int) -> list[dict[str, Any]]:
    if track.covariance is None or not np.isfinite(track.covariance[row, :2, :2]).all():
        return []
    found = []
    for name, size in _SIZES.items():
        ring, clipped = ellipse_ring(
            track.latitude[row], track.longitude[row], track.height[row], size**2 * track.covariance[row, :2, :2]
        )
        about = {"name": track.name, "kind": "ellipse", "size": name, **_moment(track, row)}
        if clipped:
            about["clipped"] = True  # larger than a quarter of the way around the Earth
        rings = [[[_position(one) for one in part]] for part in cut_ring(ring)]
        if len(rings) == 1:
            found.append(_feature({"type": "Polygon", "coordinates": rings[0]}, about))
        elif rings:
            found.append(_feature({"type": "MultiPolygon", "coordinates": rings}, about))
    return found
