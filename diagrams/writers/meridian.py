"""Lines and rings that cross the 180th meridian, cut there: section 3.1.9 of RFC 7946."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["cut_line", "cut_ring"]

Array = NDArray[np.float64]

_TURN = 360.0


def _steady(longitude: Array) -> Array:
    """Return longitudes without jumps: each within 180 degrees of the one before."""
    steps = np.diff(longitude)
    return longitude + np.concatenate([[0.0], -_TURN * np.cumsum(np.round(steps / _TURN))])


def cut_line(line: Array) -> list[Array]:
    """Return the parts of a line that lie between -180 and 180 degrees, in order.

    Parameters
    ----------
    line : ndarray, shape (k, d)
        Longitude, latitude [deg] and whatever else, which is interpolated where it is cut.
    """
    if len(line) < 2:
        return []
    points = line.copy()
    points[:, 0] = _steady(line[:, 0])
    parts: list[Array] = []
    on_edge = points[0, 0] in (-180.0, 180.0)  # then the next point says on which side it begins
    current, band = [points[0]], _band(points[:2, 0].mean() if on_edge else points[0, 0])
    for one, other in pairwise(points):
        # between neighbours there is one crossing at most
        now = _band(other[0])
        edge = 180.0 + _TURN * min(band, now)
        if now != band and other[0] != edge:
            share = (edge - one[0]) / (other[0] - one[0])
            middle = one + share * (other - one)
            middle[0] = edge
            current += [middle] if share > 0 else []
            parts.append(_shifted(current, band))
            current, band = [middle], now
        current.append(other)
    parts.append(_shifted(current, band))
    return [part for part in parts if len(part) > 1]


def _band(longitude: float) -> int:
    """Return how many turns of 360 degrees a longitude is from -180 to 180."""
    return int(np.floor((longitude + 180.0) / _TURN))


def _shifted(points: list[Array], band: int) -> Array:
    part = np.array(points)
    part[:, 0] = np.clip(part[:, 0] - _TURN * band, -180.0, 180.0)
    return part


def cut_ring(ring: Array) -> list[Array]:
    """Return a closed ring as closed rings between -180 and 180 degrees, counter-clockwise; one that holds a pole too.

    Parameters
    ----------
    ring : ndarray, shape (k, 2)
        Longitude and latitude [deg], the last point the first. Around a pole it turns once, and holds the nearer one.
    """
    points = ring.copy()
    points[:, 0] = _steady(ring[:, 0])
    if abs(points[-1, 0] - points[0, 0]) > 0.5 * _TURN:
        points = _around_pole(points)
        bands = range(1)
    else:
        bands = range(_band(points[:, 0].min()), _band(np.nextafter(points[:, 0].max(), -np.inf)) + 1)
    found = []
    for band in bands:
        west, east = -180.0 + _TURN * band, 180.0 + _TURN * band
        part = _clip(_clip(points[:-1], west, 1.0), east, -1.0)
        if len(part) < 3:
            continue
        part = part - np.array([_TURN * band, 0.0])
        x, y = (part - part[0]).T  # of a small ring no digits are lost
        area = np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)
        part = part if area >= 0 else part[::-1]
        found.append(np.concatenate([part, part[:1]]))
    return found


def _around_pole(points: Array) -> Array:
    """Return the ring from -180 to 180 degrees along the points, and back along the pole."""
    pole = 90.0 if points[:, 1].mean() > 0 else -90.0
    longitude, latitude = points[:, 0], points[:, 1]
    if longitude[-1] < longitude[0]:
        longitude, latitude = longitude[::-1], latitude[::-1]
    # one turn, and the turn after it, from -180 on
    start = -180.0 + _TURN * np.ceil((longitude[0] + 180.0) / _TURN)
    twice = np.concatenate([longitude, longitude[1:] + _TURN])
    both = np.concatenate([latitude, latitude[1:]])
    inside = (twice > start) & (twice < start + _TURN)
    at_edge = np.interp(start, twice, both)
    along = np.stack([twice[inside] - start - 180.0, both[inside]], axis=-1)
    ends = [[-180.0, at_edge]], [[180.0, at_edge], [180.0, pole], [-180.0, pole], [-180.0, at_edge]]
    return np.concatenate([ends[0], along, ends[1]])


def _clip(points: Array, meridian: float, side: float) -> Array:
    """Return an open ring without what is west (side 1) or east (-1) of a meridian (Sutherland and Hodgman, 1974)."""
    found: list[Array] = []
    for one, other in zip(points, np.roll(points, -1, axis=0), strict=True):
        first, second = side * (one[0] - meridian), side * (other[0] - meridian)
        if first >= 0:
            found.append(one)
        if first * second < 0:
            middle = one + first / (first - second) * (other - one)
            middle[0] = meridian
            found.append(middle)
    return np.array(found).reshape(-1, 2)
