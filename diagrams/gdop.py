"""Maps of the bound over the ground: how well a target could be known after the pass, wherever it is.

Figures 1 and 2 of Xu, Su and Wang, doi 10.20079/j.issn.1001-893x.220609005. The paper names neither the process noise
nor the prior; the map depends on both, so they are stated with every map.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from diagrams.bounds import bound_squares, bound_steps
from diagrams.errors import UserError, choose
from diagrams.figures.gdop import draw_gdop
from diagrams.progress import Progress
from diagrams.three_satellite import Scenario, models, satellite_orbit, target_state, track_axes
from systems.clocks import Periodic
from systems.frames import inertial_to_earth_fixed, up
from systems.measurement.stack import Stack
from systems.measurement.visibility import ElevationMask
from systems.motion.constant_velocity import ConstantVelocity
from systems.motion.great_circle import straight_line

__all__ = [
    "HEIGHT_LIMITS",
    "POSITION_LIMITS",
    "Grid",
    "Prior",
    "bound_after_pass",
    "gdop_areas",
    "gdop_figures",
    "gdop_map",
    "ground_grid",
    "measurement_sets",
]

Array = NDArray[np.float64]

POSITION_LIMITS = (1e3, 2e3, 5e3)
"""Bounds of the position error whose areas are counted [m]."""

HEIGHT_LIMITS = (1e3, 500.0)
"""Bounds of the height error whose areas are counted [m]."""

_MINIMUM_ELEVATION = 3.0  # deg


@dataclass(frozen=True)
class Prior:
    """What is known of the target before the pass; standard deviations.

    Parameters
    ----------
    height_m, horizontal_m : float
        Along the ellipsoid's normal and across it [m].
    velocity_mps : float
        Per axis [m/s].
    """

    height_m: float = 5e3
    horizontal_m: float = 500e3
    velocity_mps: float = 400.0

    def covariance(self, target: Array) -> Array:
        """Return the covariance at targets (..., 6), shape (..., 6, 6)."""
        normal = up(target[..., :3])
        vertical = normal[..., :, None] * normal[..., None, :]
        covariance = np.zeros((*target.shape, 6))
        covariance[..., :3, :3] = self.height_m**2 * vertical + self.horizontal_m**2 * (np.eye(3) - vertical)
        covariance[..., 3:, 3:] = self.velocity_mps**2 * np.eye(3)
        return covariance

    def __str__(self) -> str:
        """Return it in words."""
        return (
            f"{self.height_m / 1e3:g} km in height, {self.horizontal_m / 1e3:g} km horizontally, "
            f"{self.velocity_mps:g} m/s per axis"
        )


def measurement_sets(scenario: Scenario) -> dict[str, list[str]]:
    """Return the sets of measurement kinds that the scenario's estimators use, each once, in their order."""
    sets: dict[str, list[str]] = {}
    for options in scenario.estimators.values():
        kinds = list(getattr(options, "measurements", [])) or ["tdoa", "fdoa", "phase"]
        sets.setdefault(" + ".join(kinds), kinds)
    return sets


@dataclass(frozen=True, eq=False)
class Grid:
    """Targets over the ground, all of them at once; made by `ground_grid`.

    Parameters
    ----------
    axis : ndarray, shape (k,)
        Places at t = 0 along and across the track [km], counted from the sub-satellite point of satellite 0 at mid
        pass.
    seen : ndarray of bool, shape (k, k)
        Where all satellites stand high enough above the target's horizon, throughout.
    truth : ndarray, shape (points, time, 6)
        Straight lines from the points that are seen, in the order of ``seen``.
    platforms : ndarray, shape (1, time, satellites, 6)
        The satellites.
    times : ndarray, shape (time,)
        Epochs [s].
    """

    axis: Array
    seen: NDArray[np.bool_]
    truth: Array
    platforms: Array
    times: Array


def ground_grid(scenario: Scenario, spacing_km: float = 100.0, extent_km: float = 1500.0) -> Grid:
    """Return targets from -extent to +extent along and across the track of satellite 0.

    Raises
    ------
    UserError
        For a grid without points.
    """
    if not (np.isfinite(spacing_km) and spacing_km > 0 and np.isfinite(extent_km) and extent_km >= 0):
        raise UserError(f"gdop: a grid of {spacing_km} km up to {extent_km} km is not allowed; finite, spacing > 0")
    half = int(extent_km // spacing_km)
    axis = np.asarray(spacing_km * np.arange(-half, half + 1), dtype=float)
    orbit = satellite_orbit(scenario)
    times = Periodic(scenario.period_s).ticks(scenario.duration_s)
    platforms = inertial_to_earth_fixed(orbit.at(times), times[:, None], scenario.constants.earth_rate_radps)[None]
    start = target_state(scenario, orbit, *np.meshgrid(axis, axis, indexing="ij"))
    truth = straight_line(start[..., None, :], times)
    mask = ElevationMask(np.radians(_MINIMUM_ELEVATION))
    seen = np.asarray(mask.visible(truth, platforms).all(axis=(-1, -2)))
    return Grid(axis, seen, truth[seen], platforms, times)


def bound_after_pass(
    scenario: Scenario, grid: Grid, kinds: Sequence[str], prior: Prior, report: Callable[[int], None] | None = None
) -> Array:
    """Return the covariances (points, 6, 6) that bound the states of the grid's targets at the last epoch.

    Parameters
    ----------
    scenario : Scenario
        Noise, and the filter's process noise.
    grid : Grid
        From `ground_grid`.
    kinds : sequence of str
        ``tdoa``, ``fdoa``, ``phase_a``, ``phase_b``; ``phase`` is both phases.
    prior : Prior
        What is known before the first measurement, which is then used like all others.
    report : callable, optional
        Called with the index of every epoch that is done.

    Raises
    ------
    UserError
        For a kind that is not known.
    """
    available = models(scenario, believed=True)
    stack = Stack([available[choose("gdop: measurement", kind, available)] for kind in kinds])
    motion = ConstantVelocity(scenario.belief.acceleration_mps2)
    covariance = prior.covariance(grid.truth[:, 0])
    steps = bound_steps(grid.truth, grid.platforms, grid.times, stack, motion, covariance, first_epoch_used=False)
    for k, step in enumerate(steps):
        covariance = step
        if report is not None:
            report(k)
    return covariance


def gdop_map(
    scenario: Scenario,
    sets: Mapping[str, Sequence[str]] | None = None,
    spacing_km: float = 100.0,
    extent_km: float = 1500.0,
    prior: Prior | None = None,
    progress: bool = False,
) -> xr.Dataset:
    """Return the bound after the pass for targets on a grid over the ground.

    Parameters
    ----------
    scenario : Scenario
        Satellites, the target's height, speed and course, noise, and the filter's process noise.
    sets : mapping of str to sequence of str, optional
        Kinds of measurement by name of the set, see `bound_after_pass`; by default those of the scenario's estimators.
    spacing_km, extent_km : float
        See `ground_grid`.
    prior : Prior, optional
        What is known before the first measurement.
    progress : bool
        Show a progress bar.

    Returns
    -------
    xarray.Dataset
        ``position`` and ``height`` (set, along, cross): the bounds at the last epoch [m], by the place at t = 0, NaN
        where not all satellites are 3 deg above the target's horizon throughout. The height is that above the ellipsoid
        where the target is at the last epoch. ``track`` (time, satellite, axis): ground tracks [km]; coordinates
        ``along`` and ``cross`` [km].

    Raises
    ------
    UserError
        For a kind that is not known, or a grid without points.
    """
    prior = prior or Prior()
    sets = measurement_sets(scenario) if sets is None else sets
    grid = ground_grid(scenario, spacing_km, extent_km)
    bounds = np.full((2, len(sets), *grid.seen.shape), np.nan)
    epochs = grid.times.size
    with Progress("gdop", len(sets) * epochs, progress) as bar:
        for i, kinds in enumerate(sets.values()):
            covariance = bound_after_pass(scenario, grid, kinds, prior, _counting(bar, i * epochs))
            bounds[:, i, grid.seen] = np.sqrt(bound_squares(covariance, grid.truth[:, -1])[:2])
    axes = track_axes(scenario, satellite_orbit(scenario))
    return xr.Dataset(
        {
            "position": (("set", "along", "cross"), bounds[0]),
            "height": (("set", "along", "cross"), bounds[1]),
            "track": (("time", "satellite", "axis"), _tracks(scenario, axes, grid.platforms[0])),
        },
        coords={
            "set": list(sets),
            "along": grid.axis,
            "cross": grid.axis,
            "time": grid.times,
            "axis": ["along", "cross"],
        },
        attrs={
            "acceleration_mps2": scenario.belief.acceleration_mps2,
            "duration_s": float(grid.times[-1]),
            "prior": str(prior),
            "minimum_elevation_deg": _MINIMUM_ELEVATION,
            "target": f"{scenario.truth.height_km:g} km, {scenario.truth.speed_mps:g} m/s, "
            f"course {scenario.truth.course_deg:g} deg",
        },
    )


def _counting(bar: Progress, before: int) -> Callable[[int], None]:
    return lambda k: bar.update(before + k + 1)


def _tracks(scenario: Scenario, axes: Array, platforms: Array) -> Array:
    """Return where the satellites stand on the map, (time, satellites, 2) [km]; the inverse of `target_state`."""
    direction = platforms[..., :3] / np.linalg.norm(platforms[..., :3], axis=-1, keepdims=True)
    forward, right, upward = np.moveaxis(direction @ axes.T, -1, 0)
    radius = scenario.constants.earth_radius_m / 1e3
    return radius * np.stack([np.arctan2(forward, upward), np.arcsin(right)], axis=-1)


def gdop_areas(dataset: xr.Dataset) -> dict[str, dict[str, float]]:
    """Return the areas in which the bound is below the limits, and the bound at the centre.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `gdop_map`.

    Returns
    -------
    dict
        By set: ``visible``, ``position_below_1000_m`` ... ``height_below_500_m``: areas [10^6 km^2], as the number of
        grid points times the area of a cell; ``centre_position_m``, ``centre_height_m``.
    """
    axis = dataset["along"].values
    cell = float(axis[1] - axis[0]) ** 2 / 1e6 if axis.size > 1 else float("nan")
    found = {}
    for name in dataset["set"].values:
        chosen = dataset.sel(set=name)
        row = {"visible": cell * int(chosen["position"].notnull().sum())}
        for quantity, limits in (("position", POSITION_LIMITS), ("height", HEIGHT_LIMITS)):
            for limit in limits:
                row[f"{quantity}_below_{limit:.0f}_m"] = cell * int((chosen[quantity] < limit).sum())
            row[f"centre_{quantity}_m"] = float(chosen[quantity].sel(along=0.0, cross=0.0))
        found[str(name)] = row
    return found


def gdop_figures(scenario: Scenario, folder: Path | str, progress: bool = True) -> xr.Dataset:
    """Map the sets of the scenario's estimators, save the figures and print the areas; ``quietfix gdop``.

    Returns
    -------
    xarray.Dataset
        The map.
    """
    dataset = gdop_map(scenario, progress=progress)
    draw_gdop(dataset, folder)
    _print_areas(dataset)
    return dataset


def _print_areas(dataset: xr.Dataset) -> None:
    from rich.markup import escape
    from rich.table import Table

    from diagrams.tables import print_table

    table = Table(
        title=f"areas [10^6 km^2] with a bound below ..., {dataset.attrs['duration_s']:g} s, "
        f"process noise {dataset.attrs['acceleration_mps2']:g} m/s^2",
        caption=f"prior: {dataset.attrs['prior']}",
    )
    table.add_column("measurements", no_wrap=True)
    limits = [("position", limit) for limit in POSITION_LIMITS] + [("height", limit) for limit in HEIGHT_LIMITS]
    titles = [f"{quantity}\n{limit / 1e3:g} km" for quantity, limit in limits]
    for title in ("visible", *titles, "centre, position\nand height [km]"):
        table.add_column(escape(title), justify="right", no_wrap=True)
    for name, row in gdop_areas(dataset).items():
        cells: list[Any] = [f"{row['visible']:.2f}"]
        cells += [f"{row[f'{quantity}_below_{limit:.0f}_m']:.2f}" for quantity, limit in limits]
        cells.append(f"{row['centre_position_m'] / 1e3:.2f} / {row['centre_height_m'] / 1e3:.2f}")
        table.add_row(name, *cells)
    print_table(table)
