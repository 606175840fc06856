"""What a scene stands on: the Earth with its graticule, or a flat grid; in the axes of the frame [m]."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.pages.coast import coast_lines
from quietfix.systems.constants import WGS84_AXIS, WGS84_FLATTENING
from quietfix.systems.earth.geodetic import ecef_to_geodetic, geodetic_to_ecef

__all__ = ["COASTS", "Mesh", "Segments", "blocked", "coasts", "earth", "graticules", "grid"]

Array = NDArray[np.float64]

COASTS = "coasts"
_HALF_AXES = WGS84_AXIS * np.array([1.0, 1.0, 1 - WGS84_FLATTENING])
_RINGS, _SPOKES = 90, 120
_FINEST = 1e-3  # rad: first ring of the mesh
_NEAR = 8  # lines of the finer graticule on each side
_GRAZING = 1e-4  # of the square of a radius, 320 m: what a line may lie deeper and still pass


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles: vertices (n, 3) and faces (m, 3), which count them."""

    vertices: Array
    faces: NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class Segments:
    """Straight pieces, named for what they are: starts and ends (n, 3)."""

    name: str
    starts: Array
    ends: Array


def earth(around: Array) -> Mesh:
    """Return the WGS-84 ellipsoid as triangles in Earth-fixed axes, small ones around a place (3,).

    Rings around that place at angles that grow by a factor, so that the surface is true to some metres near the
    target and to 4 km on the other side, always from below.
    """
    pole = around / np.linalg.norm(around)
    aside = np.cross(pole, np.eye(3)[np.argmin(np.abs(pole))])
    aside /= np.linalg.norm(aside)
    angles = np.geomspace(_FINEST, np.pi / 2, _RINGS // 2)
    steps = np.linspace(np.pi / 2, np.pi, _RINGS // 2 + 1)[1:-1]
    rings = np.concatenate([np.minimum(angles, np.pi / 2), steps])[:, None, None]
    turns = np.linspace(0, 2 * np.pi, _SPOKES, endpoint=False)[None, :, None]
    level = np.cos(turns) * aside + np.sin(turns) * np.cross(pole, aside)
    units = np.concatenate([pole[None], (np.cos(rings) * pole + np.sin(rings) * level).reshape(-1, 3), -pole[None]])
    vertices = units / np.linalg.norm(units / _HALF_AXES, axis=-1, keepdims=True)
    count = len(rings)
    spokes = np.arange(_SPOKES)
    after = (spokes + 1) % _SPOKES
    start = 1 + _SPOKES * np.arange(count - 1)[:, None]
    inner, inner_next = start + spokes, start + after
    outer, outer_next = inner + _SPOKES, inner_next + _SPOKES
    last, end = 1 + _SPOKES * (count - 1), len(units) - 1
    faces = np.concatenate(
        [
            np.stack([np.zeros(_SPOKES), 1 + spokes, 1 + after], axis=-1),
            np.stack([inner, outer, outer_next], axis=-1).reshape(-1, 3),
            np.stack([inner, outer_next, inner_next], axis=-1).reshape(-1, 3),
            np.stack([last + spokes, np.full(_SPOKES, end), last + after], axis=-1),
        ]
    )
    return Mesh(vertices, faces.astype(np.int32))


def graticules(around: Array, far: float) -> list[Segments]:
    """Return meridians and parallels: every 10 degrees, and near a place (3,) those that suit a distance [m]."""
    latitudes, longitudes = np.arange(-80.0, 81.0, 10.0), np.arange(-180.0, 180.0, 10.0)
    found = [_net("every 10 deg", latitudes, longitudes, (-90.0, 90.0), (-180.0, 180.0))]
    across = np.degrees(far / WGS84_AXIS)
    step = next((s for s in (2.0, 1.0, 0.5, 0.2, 0.1) if s < across), 0.1)
    latitude, longitude, _ = (float(np.degrees(value)) for value in ecef_to_geodetic(around))
    if across < 10 and abs(latitude) < 80:
        wide = float(np.ceil(1 / np.cos(np.radians(latitude))))
        parallels = step * (np.round(latitude / step) + np.arange(-_NEAR, _NEAR + 1))
        meridians = step * (np.round(longitude / step) + wide * np.arange(-_NEAR, _NEAR + 1))
        parallels = parallels[np.abs(parallels) < 90]
        ends = (float(parallels[0]), float(parallels[-1])), (float(meridians[0]), float(meridians[-1]))
        found.append(_net(f"near the target every {step:g} deg", parallels, meridians, *ends))
    return found


def _net(
    name: str, latitudes: Array, longitudes: Array, along: tuple[float, float], across: tuple[float, float]
) -> Segments:
    """Return lines of latitude and longitude between these ends [deg], in pieces of at most a degree."""
    lat, lon = (np.linspace(a, b, max(17, int(b - a) + 1)) for a, b in (along, across))
    parallels = np.stack(np.meshgrid(latitudes, lon, indexing="ij"), axis=-1)
    meridians = np.stack(np.meshgrid(longitudes, lat, indexing="ij")[::-1], axis=-1)
    starts = np.concatenate([line[:, :-1].reshape(-1, 2) for line in (parallels, meridians)])
    ends = np.concatenate([line[:, 1:].reshape(-1, 2) for line in (parallels, meridians)])
    height = np.zeros(len(starts))
    on_ground = [
        geodetic_to_ecef(np.radians(points[:, 0]), np.radians(points[:, 1]), height) for points in (starts, ends)
    ]
    return Segments(name, on_ground[0], on_ground[1])


def coasts() -> Segments:
    """Return the coast lines of the Earth in Earth-fixed axes, in pieces of about a degree at most."""
    starts, ends = [], []
    for line in coast_lines():
        pieces = np.maximum(1, np.ceil(np.abs(np.diff(line, axis=0)).max(axis=-1))).astype(int)
        at = np.concatenate([[0.0], *(k + np.arange(1, n + 1) / n for k, n in enumerate(pieces))])
        longitude, latitude = (np.radians(np.interp(at, np.arange(len(line)), line[:, i])) for i in (0, 1))
        places = geodetic_to_ecef(latitude, longitude, np.zeros_like(latitude))
        starts.append(places[:-1])
        ends.append(places[1:])
    return Segments(COASTS, np.concatenate(starts), np.concatenate(ends))


def grid(origin: Array, axes: Array, step: float, far: float) -> Segments:
    """Return a flat grid at height 0 under a place.

    Parameters
    ----------
    origin : ndarray, shape (3,)
        The place.
    axes : ndarray, shape (3, 3)
        Its rows are two level directions and that upwards, in the axes of the frame.
    step, far : float
        Width of a square, and how far the grid reaches [m].
    """
    count = int(np.ceil(far / step))
    x, y, _ = axes @ origin
    level = [step * (np.round(value / step) + np.arange(-count, count + 1)) for value in (x, y)]
    zero = np.zeros(2 * count + 1)
    starts = [np.stack([level[0], zero + level[1][0], zero], -1), np.stack([zero + level[0][0], level[1], zero], -1)]
    ends = [np.stack([level[0], zero + level[1][-1], zero], -1), np.stack([zero + level[0][-1], level[1], zero], -1)]
    return Segments("grid", np.concatenate(starts) @ axes, np.concatenate(ends) @ axes)


def blocked(a: Array, b: Array) -> NDArray[np.bool_]:
    """Return whether the Earth is between places a and b (..., 3) [m] in geocentric axes with z to the north pole.

    Lengths over the semi-axes make a unit sphere of it: the point of the line that is nearest to the centre, between
    its ends, is inside or not.
    """
    p, q = a / _HALF_AXES, b / _HALF_AXES
    along = q - p
    length = np.maximum((along**2).sum(axis=-1), np.finfo(float).tiny)
    nearest = np.clip(-(p * along).sum(axis=-1) / length, 0, 1)
    point = p + nearest[..., None] * along
    return np.asarray((point**2).sum(axis=-1) < 1 - _GRAZING)
