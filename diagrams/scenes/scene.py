"""What a result shows in space over time, as plain numbers in the axes of its own frame [m]."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.pages.numbers import thinned
from quietfix.diagrams.quantities.frame import Frame, frame_of
from quietfix.diagrams.quantities.states import POSITION
from quietfix.diagrams.scenes.ellipsoids import PROBABILITY, ellipsoids
from quietfix.diagrams.schema.errors import UserError, choose

__all__ = ["Estimated", "Scene", "Track", "scene_of"]

Array = NDArray[np.float64]

MOST_EPOCHS, MOST_TRIALS = 300, 40
_STILL = 1.0  # m: what never leaves such a place stands still


@dataclass(frozen=True, eq=False)
class Track:
    """Something that is known to be somewhere.

    Attributes
    ----------
    name : str
    kind : str
        ``platform`` or, where it stands still, ``station``; ``target``.
    places : ndarray, shape (epochs, 3)
        NaN where it is not there; 0 along an axis that the frame does not have.
    """

    name: str
    kind: str
    places: Array


@dataclass(frozen=True, eq=False)
class Estimated:
    """Where an estimator believes that the target is.

    Attributes
    ----------
    name : str
    errors : ndarray, shape (epochs, 3)
        Of the trial that is shown: estimate less `Scene.target`.
    cloud : ndarray, shape (trials, epochs, 3)
        Of the others: estimate less truth of the same trial.
    cloud_trials : tuple of int
        Their numbers.
    axes, lengths : ndarray or None, shapes (epochs, 3, 3) and (epochs, 3)
        Unit vectors, as columns, and lengths of the semi-axes of the ellipsoid that is to hold the target; None where
        the result has no covariance.
    """

    name: str
    errors: Array
    cloud: Array
    cloud_trials: tuple[int, ...]
    axes: Array | None
    lengths: Array | None


@dataclass(frozen=True, eq=False)
class Scene:
    """A result in space and time.

    Attributes
    ----------
    title : str
    frame : Frame
    trial : int
        Number of the trial that is shown.
    times : ndarray, shape (epochs,)
        In seconds of the result, ascending.
    target : Track
        The truth; where there is none, what the first estimator says.
    known : bool
        Whether it is the truth.
    platforms : tuple of Track
    estimates : tuple of Estimated
    notes : tuple of str
        What is left out, a sentence each.
    """

    title: str
    frame: Frame
    trial: int
    times: Array
    target: Track
    known: bool
    platforms: tuple[Track, ...]
    estimates: tuple[Estimated, ...]
    notes: tuple[str, ...]


def scene_of(dataset: xr.Dataset, estimators: Sequence[str] | None = None, trial: int | None = None) -> Scene:
    """Return the scene of a study's result.

    Parameters
    ----------
    dataset : xarray.Dataset
        Of a study; see `run_study`.
    estimators : sequence of str, optional
        Which; the first one by default.
    trial : int, optional
        Number of the trial that is shown, the first one by default. Others are a cloud of dots.

    Raises
    ------
    UserError
        If the result shows no places, or has no such estimator or trial.
    """
    names = _axes(dataset)
    shown = _estimators(dataset, estimators)
    numbers = [int(n) for n in dataset["trial"].values]
    number = numbers[0] if trial is None else trial
    if number not in numbers:
        raise UserError(f"--trial: {number} is not in the result; it has {numbers[0]} to {numbers[-1]}")
    tracks_differ = "epoch" in dataset.sizes
    one = dataset.isel(trial=numbers.index(number))
    if tracks_differ:  # epochs are filled up with NaN to those of the longest track
        one = one.isel(epoch=np.flatnonzero(np.isfinite(one["time"].values)))
    axis = "epoch" if tracks_differ else "time"
    some = thinned(one.sizes[axis], MOST_EPOCHS)
    one, notes = one.isel({axis: some}), []
    if len(some) < dataset.sizes[axis] and not tracks_differ:
        notes.append(f"{len(some)} of {dataset.sizes[axis]} epochs are shown")
    truth = _placed(one["truth"], axis, "state", names) if "truth" in one else None
    known = truth is not None and bool(np.isfinite(truth).all(axis=-1).any())
    first = _placed(one["estimate"].sel(estimator=shown[0]), axis, "state", names)
    target = truth if truth is not None and known else first
    if not np.isfinite(target).all(axis=-1).any():
        raise UserError(f"--trial: {number} shows nothing; it has neither truth nor an estimate of {shown[0]}")
    if not known:
        notes.append(f"no truth is known; the target is drawn where {shown[0]} has it")
    clouded = [] if tracks_differ or not known else [i for i, n in enumerate(numbers) if n != number]
    clouded = [clouded[i] for i in thinned(len(clouded), MOST_TRIALS)] if clouded else []
    if 0 < len(clouded) < len(numbers) - 1:
        notes.append(f"{len(clouded)} of {len(numbers) - 1} other trials are dots")
    if "covariance" not in dataset:
        notes.append("no ellipsoids: the result kept no covariance (run it with --keep covariance)")
    estimates = []
    for name in shown:
        own = one["estimate"].sel(estimator=name)
        cloud = np.zeros((0, len(some), 3))
        if clouded:
            others = dataset.isel(trial=clouded).isel({axis: some})
            places = _placed(others["estimate"].sel(estimator=name), axis, "state", names)
            cloud = places - _placed(others["truth"], axis, "state", names)
        axes = lengths = None
        if "covariance" in one:
            matrices = one["covariance"].sel(estimator=name, state=names, state_=names)
            axes, lengths = ellipsoids(matrices.transpose(axis, "state", "state_").values)
        errors = _placed(own, axis, "state", names) - target
        if lost := int(np.count_nonzero(~np.isfinite(errors).all(axis=-1))):
            notes.append(f"{name} has no estimate to show at {lost} of {len(some)} epochs")
        estimates.append(Estimated(name, errors, cloud, tuple(numbers[i] for i in clouded), axes, lengths))
    if "covariance" in one:
        notes.append(f"ellipsoids hold {100 * PROBABILITY:g} % where errors are as the estimator believes")
    title = str(dataset.attrs.get("system", "result"))
    title += f":{variant}" if (variant := dataset.attrs.get("variant")) else ""
    times = np.asarray(one["time"].values, dtype=float)
    target_track = Track("target", "target", target)
    frame = frame_of(dataset)
    return Scene(
        title, frame, number, times, target_track, known, _platforms(one, axis), tuple(estimates), tuple(notes)
    )


def _axes(dataset: xr.Dataset) -> list[str]:
    """Return the components of the state that make a place."""
    missing = [name for name in ("estimate", "trial", "time") if name not in dataset]
    if "point" in dataset.dims:
        raise UserError("RESULT: it is a sweep, which keeps no places; a folder that run, replay or compare wrote")
    if missing:
        raise UserError(f"RESULT: it is damaged, or no study (no {missing[0]}); a folder that run or replay wrote")
    states = {str(name) for name in dataset["state"].values}
    names = [name for name in POSITION if name in states]
    if len(names) < 2:
        raise UserError(f"RESULT: its states have no place to show; x and y (and z) among {', '.join(sorted(states))}")
    return names


def _estimators(dataset: xr.Dataset, wanted: Sequence[str] | None) -> list[str]:
    there = [str(name) for name in dataset["estimator"].values]
    if not there:
        raise UserError("RESULT: nothing is estimated in it; one with estimators")
    return [choose("--estimator", name, there) for name in dict.fromkeys(wanted)] if wanted else there[:1]


def _placed(array: xr.DataArray, axis: str, components: str, names: Sequence[str]) -> Array:
    """Return places (..., axis, 3), with zeros along an axis that is not there."""
    values = np.asarray(array.sel({components: list(names)}).transpose(..., axis, components).values, dtype=float)
    return np.concatenate([values, np.zeros((*values.shape[:-1], 3 - len(names)))], axis=-1)


def _platforms(one: xr.Dataset, axis: str) -> tuple[Track, ...]:
    if "platforms" not in one:
        return ()
    there = [name for name in POSITION if name in one["coordinate"].values]
    places = _placed(one["platforms"].transpose("platform", axis, "coordinate"), axis, "coordinate", there)
    found = []
    for name, place in zip(one["platform"].values, places, strict=True):
        finite = place[np.isfinite(place).all(axis=-1)]
        if len(finite):
            still = float(np.ptp(finite, axis=0).max()) < _STILL
            found.append(Track(str(name), "station" if still else "platform", place))
    return tuple(found)
