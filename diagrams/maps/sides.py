"""How far the default map of a system reaches, and how close together its targets are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.map import View
from quietfix.diagrams.maps.charts import Chart, Upright
from quietfix.diagrams.schema.errors import UserError

__all__ = ["sides_of"]

Array = NDArray[np.float64]

_POINTS, _FEWEST = 31, 7  # along a side; odd, so that the scenario's own target is one of them
_NUMBERS = 2e7  # of all targets' states; long runs get fewer points
_BEYOND = 1.1  # of the furthest platform
_OVERHEAD = 0.1  # of the longest distance: at least as far, for platforms above the target
_FLATTEST = 0.25  # height of an upright plane over half its base


def sides_of(
    chart: Chart, view: View, place: Array, platforms: Array, points: int | None, size: int
) -> tuple[Array, Array]:
    """Return the coordinates of the grid's lines on a chart, vertical and horizontal ones [m].

    Parameters
    ----------
    chart : Chart
    view : View
        What is given; the rest is chosen so that the platforms and the course are on the map.
    place : ndarray, shape (time, axes)
        The course of the target [m].
    platforms : ndarray, shape (time, p, 6)
    points : int, optional
        Along a side, where no spacing is given.
    size : int
        How many numbers a target's course has.

    Raises
    ------
    UserError
        If the map has no size, is too large for the chart, or has too few or too many points.
    """
    half = _half(chart, place, platforms) if view.extent is None else view.extent
    if half > chart.furthest:
        raise UserError(f"map: an extent of {half / 1e3:g} km is not allowed; at most {chart.furthest / 1e3:.0f} km")
    most = int(np.sqrt(_NUMBERS / size))
    if view.spacing is None:
        axis = np.linspace(-half, half, points or int(np.clip(most, _FEWEST, _POINTS)) // 2 * 2 + 1)
    else:
        axis = _spaced(view.spacing, half, most)
    horizontal = chart.middle[1] + axis
    if not isinstance(chart, Upright):
        return chart.middle[0] + axis, horizontal
    top = max(2 * float(chart.middle[0]), _FLATTEST * half) if view.top is None else view.top
    return np.linspace(0.0, top, axis.size), horizontal


def _spaced(spacing: float, half: float, most: int) -> Array:
    """Return distances from the middle."""
    if spacing > half:
        raise UserError(
            f"map: a spacing of {spacing / 1e3:g} km is not allowed; at most the extent, {half / 1e3:.4g} km"
        )
    steps = int(half / spacing * (1 + 1e-9))
    if 2 * steps + 1 > most:
        raise UserError(
            f"map: a spacing of {spacing / 1e3:g} km is not allowed up to {half / 1e3:.4g} km; {most} points along a "
            "side at most, of a run with so many epochs"
        )
    return np.asarray(spacing * np.arange(-steps, steps + 1), dtype=float)


def _half(chart: Chart, place: Array, platforms: Array) -> float:
    """Return half a side, so that the platforms and the course are on the map, as far as the chart is of use."""
    spots = np.concatenate([chart.coordinates(place), chart.coordinates(platforms[..., :3]).reshape(-1, 2)])
    away = np.abs(spots - chart.middle)
    reach = _BEYOND * np.nanmax(away[:, 1:] if isinstance(chart, Upright) else away)
    distance = np.linalg.norm(platforms[..., : place.shape[-1]] - place[:, None, :], axis=-1)
    half = min(max(reach, _OVERHEAD * float(np.nanmax(distance))), chart.furthest)
    if not half > 0:
        raise UserError("gdop: the platforms are where the target is; no map has a size then")
    return float(half)
