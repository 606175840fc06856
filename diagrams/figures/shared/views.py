"""How places of a frame are seen from above and from the side, and along which axes errors are told."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.quantities.frame import Frame
from quietfix.diagrams.quantities.states import POSITION

__all__ = ["ABOVE", "Axes", "View", "error_axes", "place_names", "views_of"]

Array = NDArray[np.float64]
Axes = tuple[list[str], Callable[[Array], Array]]

_KM = 1e3

ABOVE = "from above"
"""What the view of the ground is called."""


class View(NamedTuple):
    """One way to look at places.

    Attributes
    ----------
    title : str
    labels : (str, str)
        Of the horizontal and the vertical axis, with units.
    project : callable
        Places (n, axes) [m] -> (n, 2) in those units.
    stretch : float or None
        Unit of the vertical axis over that of the horizontal one; None: free.
    """

    title: str
    labels: tuple[str, str]
    project: Callable[[Array], Array]
    stretch: float | None


def place_names(dataset: xr.Dataset) -> list[str]:
    """Return the components of the state that make a place."""
    known = {str(name) for name in dataset["state"].values}
    return [name for name in POSITION if name in known]


def error_axes(frame: Frame, size: int) -> Axes:
    """Return the axes in which errors are shown: two along the ground, and up where there is a third.

    Parameters
    ----------
    frame : Frame
        Of the states.
    size : int
        Components of a place, 2 or 3.

    Returns
    -------
    names : list of str
        Of the axes.
    rotation : callable
        Places (..., size) -> (..., axes, size): a difference of places times it is one along the axes.
    """
    if frame.ground is None or size < len(frame.ground.components):
        return list(POSITION[:size]), lambda places: np.broadcast_to(np.eye(size), (*places.shape[:-1], size, size))
    ground, upward = frame.ground, frame.up
    level = [ground.offset_labels[0], ground.offset_labels[1]]

    def rotation(places: Array) -> Array:
        unit = np.broadcast_to(np.eye(size), (*places.shape[:-1], size, size))
        along = np.swapaxes(ground.offsets(places[..., None, :], unit), -1, -2)
        if size < 3:
            return along
        if upward is not None:
            third = upward(places)
        else:  # the axis that the ground leaves
            third = np.broadcast_to(np.cross(along[..., 0, :], along[..., 1, :]), places.shape)
            third = third * np.where(third.sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)
        return np.concatenate([along, third[..., None, :]], axis=-2)

    return (level if size < 3 else [*level, "up"]), rotation


def views_of(frame: Frame, size: int, around: Array, across: int = 0) -> list[View]:
    """Return the views of a frame: from above and, where there is a third axis, from the side.

    Parameters
    ----------
    frame : Frame
        Of the places.
    size : int
        Components of a place, 2 or 3.
    around : ndarray, shape (size,)
        A place near to which all is drawn [m].
    across : int
        Which axis of the view from above is the horizontal one of that from the side.
    """
    ground, height = frame.ground, frame.height
    if ground is None or size < len(ground.components):
        pairs = [(0, 1)] if size < 3 else [(0, 1), (0, 2)]
        return [_plane(a, b) for a, b in pairs]

    def above(places: Array) -> Array:
        return ground.places(places, around)

    shown = [View(ABOVE, ground.labels, above, ground.stretch(around))]
    if size < 3:
        return shown
    if height is not None:

        def side(places: Array) -> Array:
            return np.stack([above(places)[:, across], height(places) / _KM], axis=-1)

        return [*shown, View("from the side", (ground.labels[across], "height [km]"), side, None)]
    _, rotation = error_axes(frame, size)

    def launched(places: Array) -> Array:
        up = (rotation(places)[..., 2, :] * places).sum(axis=-1) / _KM
        return np.stack([above(places)[:, across], up], axis=-1)

    return [*shown, View("from the side", (ground.labels[across], "up [km]"), launched, 1.0)]


def _plane(a: int, b: int) -> View:
    """Return the view of two of the axes themselves."""
    labels = f"{POSITION[a]} [km]", f"{POSITION[b]} [km]"
    return View(f"{POSITION[a]} and {POSITION[b]}", labels, lambda places: places[:, [a, b]] / _KM, 1.0)
