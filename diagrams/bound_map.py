"""Maps of the bound: how well a target could be known after the measurements, wherever it is.

Each system says where its targets are, what is measured of them, how they move and what is known before (`BoundMap`);
the bound at every point, the figures and the tables are the same for all. A map depends on process noise and prior, so
they are stated with it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from diagrams.bounds import bound_squares
from diagrams.errors import UserError
from diagrams.metrics import QUANTITIES
from diagrams.posterior_bound import bound_steps
from diagrams.progress import Progress
from systems.measurement.base import MeasurementModel
from systems.motion.base import MotionModel
from systems.registry import locate

__all__ = ["MAPS", "BoundMap", "Plane", "last_bound", "map_bounds", "map_figures", "map_of"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MAPS: dict[str, str] = {
    "three_satellite": "diagrams.gdop:three_satellite_map",
    "dual_satellite": "diagrams.gdop:dual_satellite_map",
    "bearing_crossing": "diagrams.gdop_bearings:bearing_map",
    "beacon_rocket": "diagrams.gdop_rocket:rocket_map",
    "satellite_ranging": "diagrams.gdop_orbits:orbit_map",
}
"""What makes a system's map, as ``module:function``: of a scenario, a `BoundMap`."""


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
    points : ndarray, shape (k, 2)
        Places to mark, stations say.
    points_label : str
    first_epoch_used : bool
        Whether the first epoch's measurement is in the prior already.
    present : ndarray of bool, shape (points, time, m), optional
        Which rows are measured.
    quantities : tuple of str
        Of `diagrams.metrics.QUANTITIES`.
    frame
        See `diagrams.assembly.model.Model`.
    equal : bool
        Whether both axes are lengths, to be drawn at the same scale.
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
    points: Array = field(default_factory=lambda: np.empty((0, 2)))
    points_label: str = ""
    first_epoch_used: bool = False
    present: Mask | None = None
    quantities: tuple[str, ...] = ("position", "height")
    frame: str = "earth_fixed"
    equal: bool = True
    report: Callable[[xr.Dataset], None] | None = None


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
    rows = [QUANTITIES.index(quantity) for quantity in of.quantities]
    with Progress("gdop", len(of.sets) * epochs, progress) as bar:
        for i, model in enumerate(of.sets.values()):
            covariance = last_bound(of, model, _counting(bar, i * epochs))
            squares = bound_squares(covariance, of.truth[:, -1], of.motion.names, of.frame)[rows]
            bounds[:, i, of.seen] = np.sqrt(squares)
    made = {quantity: (("set", *names), values) for quantity, values in zip(of.quantities, bounds, strict=True)}
    along = "time" if of.track.shape[0] == epochs else "step"
    return xr.Dataset(
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


def _counting(bar: Progress, before: int) -> Callable[[int], None]:
    return lambda k: bar.update(before + k + 1)


# -------------------------------------------------------------------------------------------------- command


def map_of(system: str) -> Callable[[Any], Any]:
    """Return what makes a system's map.

    Raises
    ------
    UserError
        If the system has none.
    """
    if system not in MAPS:
        raise UserError(f"gdop: {system} has no map; {', '.join(MAPS)} have")
    return locate(MAPS[system])


def map_figures(system: str, scenario: Any, folder: Path | str, progress: bool = True) -> xr.Dataset:
    """Map the bound of a system, save the figures and print a table; ``quietfix gdop``.

    Parameters
    ----------
    system : str
        Its name.
    scenario : dataclass
        Its scenario.
    folder : path
        An existing folder.
    progress : bool
        Show a progress bar.

    Raises
    ------
    UserError
        If the system has no map, or the scenario cannot be mapped.
    """
    from diagrams.figures.gdop import draw_gdop

    make = map_of(system)
    try:
        of = make(scenario)
    except UserError:
        raise
    except ValueError as error:  # a block says what is wrong with its arguments in the user's words
        raise UserError(str(error)) from error
    dataset = map_bounds(of, progress)
    draw_gdop(dataset, folder)
    (of.report or print_map)(dataset)
    return dataset


def print_map(dataset: xr.Dataset) -> None:
    """Print how large the bounds on a map are."""
    from diagrams.tables import Column, Table, print_table

    attributes = dataset.attrs
    headings = ("points", "least", "10 % below", "median", "90 % below", "largest")
    table = Table(
        f"bound after {attributes['duration_s']:g} s, process noise {attributes['noise']}",
        [Column("measurements"), Column("quantity"), *headings],
        keys=2,
        caption=f"prior: {attributes['prior']}; target: {attributes['target']}",
    )
    for name in dataset["set"].values:
        for quantity in attributes["quantities"]:
            values = dataset[quantity].sel(set=name).values
            values = values[np.isfinite(values)]
            unit = "m" if quantity in ("position", "height") else "m/s"
            cells = [f"{q:.4g}" for q in np.percentile(values, [0, 10, 50, 90, 100])] if values.size else ["-"] * 5
            table.add(str(name), f"{quantity} [{unit}]", str(values.size), *cells)
    print_table(table)
