"""Coast lines of the Earth, 1:110 million: Natural Earth, in the public domain; see ``look/README.md``."""

from __future__ import annotations

import json
from functools import cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

__all__ = ["COAST_NOTE", "coast_lines", "coast_within"]

Array = NDArray[np.float64]

COAST_NOTE = "coast lines: Natural Earth, 1:110 million"
_HUNDREDTH = 0.01  # deg


@cache
def coast_lines() -> tuple[Array, ...]:
    """Return coast lines, (points, 2) each: longitude and latitude [deg]."""
    text = (files("quietfix.diagrams.pages") / "look" / "coast-110m.json").read_text(encoding="utf-8")
    return tuple(_HUNDREDTH * np.cumsum(np.reshape(line, (-1, 2)), axis=0) for line in json.loads(text)["lines"])


def coast_within(west: float, east: float, south: float, north: float) -> list[Array]:
    """Return what of the coast lines is within a rectangle, with the points just outside; in its longitudes [deg].

    Parameters
    ----------
    west, east, south, north : float
        The rectangle [deg]; longitudes may go on beyond 180 degrees.
    """
    found = []
    turns = range(int(np.floor((west + 180) / 360)), int(np.floor((east + 180) / 360)) + 1)
    for turn in turns:
        for line in coast_lines():
            x, y = line[:, 0] + 360 * turn, line[:, 1]
            inside = (x >= west) & (x <= east) & (y >= south) & (y <= north)
            near = inside.copy()
            near[1:] |= inside[:-1]
            near[:-1] |= inside[1:]
            edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(int)))
            found += [np.stack([x[a:b], y[a:b]], axis=-1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return found
