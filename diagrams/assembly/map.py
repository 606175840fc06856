"""What a map of the bound is made of: targets on a plane, and all that their bound depends on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.quantities.frame import EARTH_FIXED, Frame
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["BoundMap", "Plane", "View"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Plane:
    """Where the targets of a map are: a grid with a name and a label for either axis.

    Parameters
    ----------
    names : (str, str)
        Of the vertical and of the horizontal axis of the figure.
    labels : (str, str)
        The same with units.
    values : (ndarray, ndarray), shapes (k,) and (l,)
        In the units of the labels.
    """

    names: tuple[str, str]
    labels: tuple[str, str]
    values: tuple[Array, Array]


@dataclass(frozen=True, eq=False)
class BoundMap:
    """Targets on a plane, and all that their bound depends on.

    Parameters
    ----------
    plane : Plane
    seen : ndarray of bool, shape (k, l)
        Which points have a bound.
    truth : ndarray, shape (points, time, n)
        The targets of the points that are seen, row after row.
    platforms : ndarray, shape (1, time, p, 6)
        Known carriers.
    times : ndarray, shape (time,)
        Epochs [s].
    sets : mapping of str to MeasurementModel
        What is measured, by name.
    motion : MotionModel
        With the filter's process noise.
    prior : ndarray, shape (points or 1, n, n)
        Covariance before the first measurement.
    stated : mapping of str to str
        In words: ``noise`` (process noise), ``prior``, ``target``.
    track : ndarray, shape (steps, curves, 2)
        Curves to draw, vertical and horizontal coordinate.
    track_labels : sequence of str
        What they are; the same word twice is one entry.
    track_names : sequence of str
        Names of the curves, to be written beside them, where they have names.
    points : ndarray, shape (k, 2)
        Places to mark, stations say.
    points_label : str
    point_names : sequence of str
        Names of the places, where they have names.
    first_epoch_used : bool
        Whether the first epoch's measurement is in the prior already.
    present : ndarray of bool, shape (points, time, m), optional
        Which rows are measured.
    quantities : tuple of str
        Of `quietfix.diagrams.statistics.state_errors.QUANTITIES`.
    frame : Frame, or its name
        See `quietfix.diagrams.assembly.model.Model`.
    equal : bool
        Whether both axes are lengths, to be drawn at the same scale.
    judged : sequence of str, optional
        Components that the truth has; the bound is of these. By default all of the motion's.
    report : callable, optional
        Prints a table of the map's own instead of `print_map`.
    """

    plane: Plane
    seen: Mask
    truth: Array
    platforms: Array
    times: Array
    sets: Mapping[str, MeasurementModel]
    motion: MotionModel
    prior: Array
    stated: Mapping[str, str]
    track: Array = field(default_factory=lambda: np.empty((0, 0, 2)))
    track_labels: tuple[str, ...] = ()
    track_names: tuple[str, ...] = ()
    points: Array = field(default_factory=lambda: np.empty((0, 2)))
    points_label: str = ""
    point_names: tuple[str, ...] = ()
    first_epoch_used: bool = False
    present: Mask | None = None
    quantities: tuple[str, ...] = ("position", "height")
    frame: Frame | str = EARTH_FIXED
    equal: bool = True
    judged: Sequence[str] | None = None
    report: Callable[[xr.Dataset], None] | None = None


@dataclass(frozen=True, eq=False)
class View:
    """Which part of space the default map of a system shows; None: what `quietfix.diagrams.maps.default` makes of it.

    Parameters
    ----------
    centre : ndarray, shape (3,), optional
        A place in the axes of the frame [m]; the middle of the map is over or below it.
    height : float, optional
        Of the targets, where the frame has heights [m].
    plane : {'level', 'east_up', 'north_up'}
        Targets side by side, or one above the other.
    extent : float, optional
        Half a side of the square, or of its base [m].
    spacing : float, optional
        Between targets side by side [m].
    top : float, optional
        Of an upright plane, which begins at height 0 [m].
    """

    centre: Array | None = None
    height: float | None = None
    plane: str = "level"
    extent: float | None = None
    spacing: float | None = None
    top: float | None = None
