"""The bound at every point of a map, after the last measurement.

What a map is of is a `BoundMap`; the bound, the figures and the tables are the same for all. A map depends on process
noise and prior, so they are stated with it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.assembly.map import BoundMap
from quietfix.diagrams.console.progress import Progress
from quietfix.diagrams.quantities.frame import UNITS
from quietfix.diagrams.quantities.states import block, columns
from quietfix.diagrams.statistics.bounds import bound_squares
from quietfix.diagrams.statistics.posterior_bound import bound_steps
from quietfix.diagrams.statistics.state_errors import QUANTITIES
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["last_bound", "map_bounds"]

Array = NDArray[np.float64]


def last_bound(of: BoundMap, model: MeasurementModel, report: Callable[[int], None] | None = None) -> Array:
    """Return the covariances (points, n, n) that bound the states of a map's targets at the last epoch.

    Parameters
    ----------
    of : BoundMap
    model : MeasurementModel
        One of its sets, or another.
    report : callable, optional
        Called with the index of every epoch that is done.
    """
    covariance = of.prior
    steps = bound_steps(of.truth, of.platforms, of.times, model, of.motion, of.prior, of.first_epoch_used, of.present)
    for k, step in enumerate(steps):
        covariance = step
        if report is not None:
            report(k)
    return covariance


def map_bounds(of: BoundMap, progress: bool = False) -> xr.Dataset:
    """Return the bound at the last epoch at every point of a map.

    Parameters
    ----------
    of : BoundMap
    progress : bool
        Show a progress bar.

    Returns
    -------
    xarray.Dataset
        A variable per quantity, (set, vertical axis, horizontal axis), in SI units and NaN where nothing is seen;
        ``track`` (time, curve, axis) and ``point`` (mark, axis) for the figure; attributes say what the map is of.
    """
    names, epochs = of.plane.names, of.times.size
    bounds = np.full((len(of.quantities), len(of.sets), *of.seen.shape), np.nan)
    judged = of.motion.names if of.judged is None else of.judged
    places = columns(of.motion.names, judged)
    rows = [QUANTITIES.index(quantity) for quantity in of.quantities]
    with Progress("gdop", len(of.sets) * epochs, progress) as bar:
        for i, model in enumerate(of.sets.values()):
            covariance = last_bound(of, model, _counting(bar, i * epochs))
            squares = bound_squares(block(covariance, places), of.truth[:, -1][..., places], judged, of.frame)[rows]
            bounds[:, i, of.seen] = np.sqrt(squares)
    made = {quantity: (("set", *names), values) for quantity, values in zip(of.quantities, bounds, strict=True)}
    along = "time" if of.track.shape[0] == epochs else "step"
    dataset = xr.Dataset(
        {
            **made,
            "track": ((along, "curve", "axis"), of.track),
            "point": (("mark", "axis"), of.points),
        },
        coords={
            "set": list(of.sets),
            names[0]: of.plane.values[0],
            names[1]: of.plane.values[1],
            "axis": list(names),
            "curve": _or_numbers(of.track_names, of.track.shape[1]),
            "mark": _or_numbers(of.point_names, len(of.points)),
            **({"time": of.times} if along == "time" else {}),
        },
        attrs={
            "quantities": list(of.quantities),
            "vertical": names[0],
            "horizontal": names[1],
            "vertical_label": of.plane.labels[0],
            "horizontal_label": of.plane.labels[1],
            "duration_s": float(of.times[-1] - of.times[0]),
            "track_labels": list(of.track_labels),
            "points_label": of.points_label,
            "equal": int(of.equal),
            **of.stated,
        },
    )
    return _described(dataset, of)


def _or_numbers(names: Sequence[str], size: int) -> list[Any]:
    return list(names) if len(names) == size else list(range(size))


def _described(dataset: xr.Dataset, of: BoundMap) -> xr.Dataset:
    """Return a map whose variables and coordinates all have ``units`` and ``long_name``."""
    about = {
        "set": ("1", "what is measured"),
        "axis": ("1", "axis of the map"),
        "curve": ("1", "name of a curve"),
        "mark": ("1", "name of a place"),
        "time": ("s", "time since the start of the run"),
        "track": ("as the axes of the map", "curves on the map"),
        "point": ("as the axes of the map", "places on the map"),
    }
    about |= {what: (UNITS[what], f"bound of the {what}") for what in of.quantities}
    for name, label in zip(of.plane.names, of.plane.labels, strict=True):
        words, _, unit = label.partition(" [")
        about[name] = (unit.rstrip("]") or "1", words)
    for variable in dataset.variables:
        units, words = about[str(variable)]
        dataset[variable].attrs |= {"units": units, "long_name": words}
    return dataset


def _counting(bar: Progress, before: int) -> Callable[[int], None]:
    return lambda k: bar.update(before + k + 1)
