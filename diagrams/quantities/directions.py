"""Directions of a target's state in the words of the field: up, along the course, in range ..."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.earth.geodetic import up

__all__ = [
    "Directions",
    "earth_directions",
    "inertial_directions",
    "launch_directions",
    "local_directions",
    "named_components",
]

Array = NDArray[np.float64]

_KINDS = {"position": "", "velocity": "v", "acceleration": "a"}
"""Kinds of vectors, and what stands before x, y, z in the names of their components."""

_LABELS = {
    "position up": "height",
    "velocity up": "vertical velocity",
    "position in range": "range",
    "velocity in range": "range rate",
    "position in cross-range": "cross-range",
}
_AT_REST = 1e-6  # m/s; slower has no course
_LEVEL = 0.02  # sine of a line of sight's elevation; a flatter one is told in range along the ground and height


class Directions(NamedTuple):
    """Directions that positions and velocities are told in.

    Attributes
    ----------
    names : list of str
        None, where there is no such direction.
    rotation : ndarray, shape (axes, axes)
        Their unit vectors as rows; the axes as they are, where there is none.
    sighted : bool
        Whether they are along and across the line of sight from a platform.
    """

    names: list[str]
    rotation: Array
    sighted: bool = False


def earth_directions(place: Array, velocity: Array, platform: Array) -> Directions:
    """Return ``up``, ``along the course``, ``across the course``; ``to the north`` and ``east`` of a target at rest.

    Parameters
    ----------
    place, velocity : ndarray, shape (axes,)
        Of the target, Earth-fixed; the velocity is zero where the state has none.
    platform : ndarray, shape (6,)
        Of the first platform.
    """
    if place.size < 3:
        return _as_they_are(place)
    normal = up(place)
    level = velocity - normal * (normal @ velocity)
    moving = np.linalg.norm(level) > _AT_REST
    ahead = level if moving else np.array([0.0, 0.0, 1.0]) - normal * normal[2]
    ahead /= np.linalg.norm(ahead)
    names = ["along the course", "across the course"] if moving else ["to the north", "to the east"]
    return Directions(["up", *names], np.stack([normal, ahead, np.cross(ahead, normal)]))


def local_directions(place: Array, velocity: Array, platform: Array) -> Directions:
    """Return ``in range``, ``in cross-range``, ``in elevation`` from the platform; ``up`` if that is nearly level.

    Arguments as of `earth_directions`, in local axes.
    """
    axes = place.size
    if axes < 3:
        return _plane_directions(place, platform)
    sight = place - platform[:axes]
    sight = sight / np.linalg.norm(sight)
    side = np.cross([0.0, 0.0, 1.0], sight)
    if not np.linalg.norm(side) > 0:  # straight above or below
        return Directions(["to the east", "to the north", "up"], np.eye(3))
    side = side / np.linalg.norm(side)
    third = "in elevation"
    if abs(sight[2]) < _LEVEL:
        sight, third = np.cross(side, [0.0, 0.0, 1.0]), "up"
    return Directions(["in range", "in cross-range", third], np.stack([sight, side, np.cross(sight, side)]), True)


def inertial_directions(place: Array, velocity: Array, platform: Array) -> Directions:
    """Return ``in range``, ``along the track``, ``across the track``; arguments as of `earth_directions`, inertial."""
    axes = place.size
    if axes < 3:
        return _plane_directions(place, platform)
    sight = place - platform[:axes]
    sight = sight / np.linalg.norm(sight)
    ahead = velocity - sight * (sight @ velocity)
    ahead /= np.linalg.norm(ahead)
    words = ["in range", "along the track", "across the track"]
    return Directions(words, np.stack([sight, ahead, np.cross(sight, ahead)]), True)


def launch_directions(place: Array, velocity: Array, platform: Array) -> Directions:
    """Return ``down-range``, ``up at the site``, ``across``, the axes of the launch frame themselves."""
    if place.size < 3:
        return _as_they_are(place)
    return Directions(["down-range", "up at the site", "across"], np.eye(3))


def _plane_directions(place: Array, platform: Array) -> Directions:
    sight = place - platform[: place.size]
    distance = np.linalg.norm(sight)
    if place.size < 2 or not distance > 0:
        return _as_they_are(place)
    sight = sight / distance
    return Directions(["in range", "in cross-range"], np.stack([sight, [-sight[1], sight[0]]]), True)


def _as_they_are(place: Array) -> Directions:
    return Directions([], np.eye(place.size))


def named_components(names: Sequence[str], words: Sequence[str], rotation: Array) -> tuple[list[str], Array]:
    """Return what the state's components are called after turning, and the turning (n, n): rows are components.

    Parameters
    ----------
    names : sequence of str
        Components of the state.
    words, rotation
        Of `Directions`.
    """
    labels, turned = list(names), np.eye(len(names))
    for kind, letter in _KINDS.items():
        block = [list(names).index(letter + axis) for axis in "xyz" if letter + axis in names]
        if len(block) != len(words):
            continue
        turned[np.ix_(block, block)] = rotation
        for i, word in zip(block, words, strict=True):
            labels[i] = _LABELS.get(f"{kind} {word}", f"{kind} {word}")
    return labels, turned
