"""Estimate minus truth in the terms of the field: position, height, velocity, speed, course, bias.

Where the *truth* is NaN the error is NaN: nothing is known there. Where the *estimate* is not finite the error is
infinite: the trial is lost.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.quantities.frame import UNITS, frame_of
from quietfix.diagrams.quantities.states import POSITION, VELOCITY
from quietfix.diagrams.statistics.epochs import along
from quietfix.systems.angle_wrapping import wrap

__all__ = ["BOUNDS", "NEEDED", "QUANTITIES", "axis_errors", "errors", "scored"]

Array = NDArray[np.float64]

QUANTITIES = tuple(UNITS)
"""What errors and bounds are about: position and height [m], velocity and horizontal speed [m/s], course [deg], and
bias [m/s] where it is in the state."""

NEEDED = {
    "position": POSITION,
    "height": POSITION,
    "velocity": VELOCITY,
    "speed": (*POSITION, *VELOCITY),
    "course": (*POSITION, *VELOCITY),
    "bias": ("bias",),
}
"""Which components of the state each of `QUANTITIES` is made of."""

BOUNDS = tuple(f"{kind}_{what}" for kind in ("bound", "bound_truth") for what in QUANTITIES)
"""Names of the bounds that a result may carry, each (estimator, time), in the units of `QUANTITIES`."""

_AT_REST = 1e-6  # m/s; below it a course means nothing


def scored(dataset: xr.Dataset) -> xr.DataArray:
    """Return which components each estimator can be judged by: those that its state and the truth both have.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result; without the coordinates ``in_truth`` and ``in_estimate`` all have all.

    Returns
    -------
    xarray.DataArray of bool, dims (estimator, state)
    """
    shape = dataset.sizes["estimator"], dataset.sizes["state"]
    both = np.ones(shape, dtype=bool)
    if "in_truth" in dataset.coords:
        both &= dataset["in_truth"].values
    if "in_estimate" in dataset.coords:
        both &= dataset["in_estimate"].transpose("estimator", "state").values
    names = {name: dataset[name].values for name in ("estimator", "state")}
    return xr.DataArray(both, names, ("estimator", "state"))


def axis_errors(dataset: xr.Dataset) -> xr.DataArray:
    """Return estimate minus truth per component of the state.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result.

    Returns
    -------
    xarray.DataArray, dims (estimator, trial, time, state)
        NaN where the truth is unknown or the component is not in both states, infinite where the estimate is not
        finite.
    """
    difference = dataset["estimate"] - dataset["truth"]
    lost = ~np.isfinite(dataset["estimate"]) & np.isfinite(dataset["truth"]) & scored(dataset)
    return difference.where(~lost, np.inf).transpose("estimator", "trial", along(dataset), "state")


def errors(dataset: xr.Dataset, only: Collection[str] = QUANTITIES) -> xr.Dataset:
    """Return the errors of a study in the terms of the field.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result; its state has x, y and maybe z, and vx, vy and maybe vz if there is a velocity, in the axes
        that the attribute ``frame`` names (Earth-fixed ones without it).
    only : collection of str
        Which of `QUANTITIES` are wanted; others may be left out.

    Returns
    -------
    xarray.Dataset, dims (estimator, trial, time), or epoch in the place of time (see
    `quietfix.diagrams.statistics.epochs`)
        ``position`` [m] and ``velocity`` [m/s]: length of the error vector. Signed, estimate minus truth:
        ``height`` above the WGS-84 ellipsoid, or z in local axes [m], horizontal ``speed`` [m/s], ``course`` clockwise
        from north [deg] in [-180, 180), NaN where truth or estimate is at rest. A state without a velocity has
        ``position`` and ``height`` only, one in the plane no ``height``; inertial and launch axes (attribute
        ``frame``) have ``position`` and ``velocity`` only. Where the state has a component ``bias`` its signed error
        is there as well. What the truth does not have has no error; one that takes a component which this
        estimator does not have is NaN.
    """
    states = [str(name) for name in dataset["state"].values]
    true = set(states) if "in_truth" not in dataset.coords else {*dataset["state"].values[dataset["in_truth"].values]}
    frame = frame_of(dataset)
    has = frame.quantities(true)
    place = [states.index(name) for name in POSITION if name in true]
    own = scored(dataset).values[:, None, None, :]
    moving = [states.index(name) for name in VELOCITY if name in true] if {*only} - {"position", "height"} else []
    axis = along(dataset)
    dims = ("estimator", "trial", axis)
    estimate = dataset["estimate"].transpose(*dims, "state").values
    truth = dataset["truth"]
    truth = truth.transpose(*(dim for dim in ("trial", axis, "state") if dim in truth.dims))
    known = np.broadcast_to(truth.values, estimate.shape)
    finite = np.isfinite(estimate)
    # A stand-in keeps the geometry free of NaN; what it gives is replaced by infinity below.
    usable = np.where(finite, estimate, known)

    def judged(error: Array, columns: list[int]) -> tuple[tuple[str, ...], Array]:
        lost = ~finite[..., columns].all(axis=-1) | ~np.isfinite(error)
        unknown = ~np.isfinite(known[..., columns]).all(axis=-1) | ~own[..., columns].all(axis=-1)
        return dims, np.where(unknown, np.nan, np.where(lost, np.inf, error))

    found = {}
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        here, there = usable[..., place], truth.values[..., place]
        apart = np.linalg.norm(here - there, axis=-1) if place else np.full(estimate.shape[:-1], np.nan)
        found["position"] = judged(apart, place) if place else (dims, apart)
        if moving:
            moved, true_moved = usable[..., moving], truth.values[..., moving]
            found["velocity"] = judged(np.linalg.norm(moved - true_moved, axis=-1), moving)
        if frame.height is not None and "height" in has and "height" in only:
            found["height"] = judged(frame.height(here) - frame.height(there), place)
        if frame.course_and_speed is not None and "speed" in has and moving:
            both = [*place, *moving]
            course, speed = frame.course_and_speed(here, moved)
            true_course, true_speed = frame.course_and_speed(there, true_moved)
            found["speed"] = judged(speed - true_speed, both)
            turned = judged(np.degrees(wrap(course - true_course)), both)[1]
            found["course"] = dims, np.where(np.minimum(speed, true_speed) < _AT_REST, np.nan, turned)
        if "bias" in has:
            column = [states.index("bias")]
            found["bias"] = judged((usable - known)[..., column[0]], column)
    names = {name: dataset[name] for name in dims if name in dataset.coords}
    return xr.Dataset(found, coords=names)
