"""Directions of a target's state in the words of the field: up, along the course, in range ..."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from systems.geodetic import up

__all__ = ["direction_axes", "named_components"]

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


def direction_axes(place: Array, velocity: Array, carrier: Array, frame: str) -> tuple[list[str], Array]:
    """Return the directions that positions and velocities are told in.

    Parameters
    ----------
    place, velocity : ndarray, shape (axes,)
        Of the target; the velocity is zero where the state has none.
    carrier : ndarray, shape (6,)
        Of the first carrier.
    frame : {'earth_fixed', 'local', 'inertial', 'launch'}
        See `diagrams.assembly.model.Model`.

    Returns
    -------
    names : list of str
        ``up``, ``along the course``, ``across the course`` (north and east of a target at rest) on the Earth; ``in
        range``, ``in cross-range``, ``in elevation`` (``up`` if the line of sight is nearly level) from the carrier in
        local axes; ``in range``, ``along the track``, ``across the track`` in inertial ones; ``down-range``, ``up at
        the site``, ``across`` at a launch. None, with the axes as they are, where there is no such direction.
    rotation : ndarray, shape (axes, axes)
        Their unit vectors as rows.
    """
    axes = place.size
    sight = place - carrier[:axes]
    distance = np.linalg.norm(sight)
    if axes < 2 or (axes == 2 and not distance > 0):
        return [], np.eye(axes)
    if frame == "launch":
        return ["down-range", "up at the site", "across"], np.eye(3)
    if frame == "earth_fixed":
        normal = up(place)
        level = velocity - normal * (normal @ velocity)
        moving = np.linalg.norm(level) > _AT_REST
        ahead = level if moving else np.array([0.0, 0.0, 1.0]) - normal * normal[2]
        ahead /= np.linalg.norm(ahead)
        names = ["along the course", "across the course"] if moving else ["to the north", "to the east"]
        return ["up", *names], np.stack([normal, ahead, np.cross(ahead, normal)])
    sight = sight / distance
    if axes == 2:
        return ["in range", "in cross-range"], np.stack([sight, [-sight[1], sight[0]]])
    if frame == "local":
        side = np.cross([0.0, 0.0, 1.0], sight)
        if not np.linalg.norm(side) > 0:  # straight above or below
            return ["to the east", "to the north", "up"], np.eye(3)
        side = side / np.linalg.norm(side)
        third = "in elevation"
        if abs(sight[2]) < _LEVEL:
            sight, third = np.cross(side, [0.0, 0.0, 1.0]), "up"
        return ["in range", "in cross-range", third], np.stack([sight, side, np.cross(sight, side)])
    ahead = velocity - sight * (sight @ velocity)
    ahead /= np.linalg.norm(ahead)
    return ["in range", "along the track", "across the track"], np.stack([sight, ahead, np.cross(sight, ahead)])


def named_components(names: Sequence[str], words: Sequence[str], rotation: Array) -> tuple[list[str], Array]:
    """Return what the state's components are called after turning, and the turning (n, n): rows are components.

    Parameters
    ----------
    names : sequence of str
        Components of the state.
    words, rotation
        From `direction_axes`.
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
