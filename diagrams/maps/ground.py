"""Maps of the bound over the ground under satellites: how well a target could be known after the pass.

Figures 1 and 2 of Xu, Su and Wang, doi 10.20079/j.issn.1001-893x.220609005. The paper names neither the process noise
nor the prior; the map depends on both, so they are stated with every map.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.map import BoundMap, Plane
from quietfix.diagrams.parts.formation import satellite_orbit
from quietfix.diagrams.parts.ground import Airborne, beside_track, track_axes, tracks
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.clocks import Periodic
from quietfix.systems.earth.frames import inertial_to_earth_fixed
from quietfix.systems.earth.geodetic import up
from quietfix.systems.geometry.visibility import ElevationMask
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.constant_velocity import ConstantVelocity
from quietfix.systems.trajectories.great_circle import straight_line

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["HEIGHT_LIMITS", "POSITION_LIMITS", "GroundGrid", "GroundPrior", "ground_areas", "ground_grid", "ground_map"]

Array = NDArray[np.float64]

POSITION_LIMITS = (1e3, 2e3, 5e3)
"""Bounds of the position error whose areas are counted [m]."""

HEIGHT_LIMITS = (1e3, 500.0)
"""Bounds of the height error whose areas are counted [m]."""

_MINIMUM_ELEVATION = 3.0  # deg


@dataclass(frozen=True)
class GroundPrior:
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


@dataclass(frozen=True, eq=False)
class GroundGrid:
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
    axes : ndarray, shape (3, 3)
        From `track_axes`.
    """

    axis: Array
    seen: NDArray[np.bool_]
    truth: Array
    platforms: Array
    times: Array
    axes: Array


def ground_grid(scenario: Airborne, spacing_km: float = 100.0, extent_km: float = 1500.0, count: int = 3) -> GroundGrid:
    """Return targets from -extent to +extent along and across the track of satellite 0, of `count` satellites.

    Raises
    ------
    UserError
        For a grid without points.
    """
    if not (np.isfinite(spacing_km) and spacing_km > 0 and np.isfinite(extent_km) and extent_km >= 0):
        raise UserError(f"gdop: a grid of {spacing_km} km up to {extent_km} km is not allowed; finite, spacing > 0")
    half = int(extent_km // spacing_km)
    axis = np.asarray(spacing_km * np.arange(-half, half + 1), dtype=float)
    orbit = satellite_orbit(scenario, count)
    times = Periodic(scenario.period_s).ticks(scenario.duration_s)
    platforms = inertial_to_earth_fixed(orbit.at(times), times[:, None], scenario.constants.earth_rate_radps)[None]
    start = beside_track(scenario, orbit, *np.meshgrid(axis, axis, indexing="ij"))
    truth = straight_line(start[..., None, :], times)
    mask = ElevationMask(np.radians(_MINIMUM_ELEVATION))
    seen = np.asarray(mask.visible(truth, platforms).all(axis=(-1, -2)))
    return GroundGrid(axis, seen, truth[seen], platforms, times, track_axes(scenario, orbit))


def ground_map(
    scenario: Airborne,
    grid: GroundGrid,
    sets: Mapping[str, MeasurementModel],
    acceleration: float,
    prior: GroundPrior,
    platforms: Sequence[str],
) -> BoundMap:
    """Return the map of targets over the ground under satellites.

    Parameters
    ----------
    scenario : Airborne
        Satellites, and the target's height, speed and course.
    grid : GroundGrid
        From `ground_grid`.
    sets : mapping of str to MeasurementModel
        What is measured.
    acceleration : float
        Process noise of the filter's model of constant velocity [m/s^2].
    prior : GroundPrior
        What is known before the first measurement, which is then used like all others.
    platforms : sequence of str
        Names of the satellites.
    """
    truth = scenario.truth
    return BoundMap(
        plane=Plane(
            ("along", "cross"),
            (f"along the track of {platforms[0]} [km]", "across it, right positive [km]"),
            (grid.axis, grid.axis),
        ),
        seen=grid.seen,
        truth=grid.truth,
        platforms=grid.platforms,
        times=grid.times,
        sets=sets,
        motion=ConstantVelocity(acceleration),
        prior=prior.covariance(grid.truth[:, 0]),
        stated={
            "noise": f"{acceleration:g} m/s^2",
            "prior": str(prior),
            "target": f"{truth.height_km:g} km, {truth.speed_mps:g} m/s, course {truth.course_deg:g} deg; "
            f"satellites above {_MINIMUM_ELEVATION:g} deg throughout",
        },
        track=tracks(scenario, grid.axes, grid.platforms[0]),
        track_labels=("ground tracks",) * grid.platforms.shape[2],
        track_names=tuple(platforms),
        report=_print_areas,
    )


def ground_areas(dataset: xr.Dataset) -> dict[str, dict[str, float]]:
    """Return the areas in which the bound is below the limits, and the bound at the centre.

    Parameters
    ----------
    dataset : xarray.Dataset
        Bounds on a `ground_map`.

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


def _print_areas(dataset: xr.Dataset) -> None:
    from quietfix.diagrams.console.answer import tell
    from quietfix.diagrams.console.tables import Column, Table, print_table

    areas = ground_areas(dataset)
    tell(
        areas_million_km2={n: {k: v for k, v in row.items() if "centre" not in k} for n, row in areas.items()},
        centre={n: {k.removeprefix("centre_"): v for k, v in row.items() if "centre" in k} for n, row in areas.items()},
    )
    limits = [("position", limit) for limit in POSITION_LIMITS] + [("height", limit) for limit in HEIGHT_LIMITS]
    titles = [f"{quantity} {limit / 1e3:g} km" for quantity, limit in limits]
    table = Table(
        f"areas [10^6 km^2] with a bound below ..., {dataset.attrs['duration_s']:g} s, "
        f"process noise {dataset.attrs['noise']}",
        [Column("measurements"), "visible", *titles, "centre, position and height [km]"],
        caption=f"prior: {dataset.attrs['prior']}",
    )
    for name, row in areas.items():
        cells: list[Any] = [f"{row['visible']:.2f}"]
        cells += [f"{row[f'{quantity}_below_{limit:.0f}_m']:.2f}" for quantity, limit in limits]
        cells.append(f"{row['centre_position_m'] / 1e3:.2f} / {row['centre_height_m'] / 1e3:.2f}")
        table.add(name, *cells)
    print_table(table)
