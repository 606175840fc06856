"""What `quietfix gdop` does: the maps of a system, their figures and tables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from quietfix.diagrams.assembly.map import BoundMap
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.console.answer import tell
from quietfix.diagrams.maps.bounds import map_bounds
from quietfix.diagrams.maps.default import default_maps
from quietfix.diagrams.schema.errors import UserError

__all__ = ["bound_maps", "map_figures", "print_map", "told_of_map"]

_PERCENTILES = {"least": 0, "percentile_10": 10, "median": 50, "percentile_90": 90, "largest": 100}


def bound_maps(system: System, scenario: Any) -> list[BoundMap]:
    """Return the map that a system offers of a scenario, or the default ones: one for each set of measurements.

    Raises
    ------
    UserError
        If the scenario cannot be built or mapped.
    """
    try:
        model = system.declare(scenario)
        return [model.map()] if model.map else default_maps(model, scenario.estimators)
    except UserError:
        raise
    except ValueError as error:  # a block says what is wrong with its arguments in the user's words
        raise UserError(str(error)) from error


def map_figures(system: System, scenario: Any, folder: Path | str, progress: bool = True) -> list[xr.Dataset]:
    """Map the bound of a system, save the figures and print a table for each map.

    Parameters
    ----------
    system : System
    scenario : dataclass
        Its scenario.
    folder : path
        An existing folder.
    progress : bool
        Show a progress bar.

    Raises
    ------
    UserError
        If the scenario cannot be built or mapped.
    """
    from quietfix.diagrams.figures.gdop import draw_gdop

    found = []
    for of in bound_maps(system, scenario):
        dataset = map_bounds(of, progress)
        draw_gdop(dataset, folder)
        (of.report or print_map)(dataset)
        found.append(dataset)
    tell(maps=[told_of_map(dataset) for dataset in found])
    return found


def told_of_map(dataset: xr.Dataset) -> dict[str, Any]:
    """Return how large the bounds on a map are, as JSON has it: what `print_map` prints, and what the map is of."""
    attributes = dataset.attrs
    sets: dict[str, Any] = {}
    for name in dataset["set"].values:
        row = sets.setdefault(str(name), {})
        for quantity in attributes["quantities"]:
            percentiles, count = _percentiles(dataset, str(name), quantity)
            tail = f"{quantity}_{dataset[quantity].attrs['units'].replace('/', 'p')}"
            row[tail] = {"points": count} | dict(zip(_PERCENTILES, percentiles, strict=True))
    facts = {key: attributes[key] for key in ("noise", "prior", "target")}
    return {"duration_s": attributes["duration_s"], **facts, "sets": sets}


def _percentiles(dataset: xr.Dataset, name: str, quantity: str) -> tuple[list[float], int]:
    """Return least, 10 %, median, 90 % and largest of a bound where there is one, and at how many points that is."""
    values = dataset[quantity].sel(set=name).values
    values = values[np.isfinite(values)]
    found = np.percentile(values, list(_PERCENTILES.values())) if values.size else np.full(len(_PERCENTILES), np.nan)
    return [float(value) for value in found], int(values.size)


def print_map(dataset: xr.Dataset) -> None:
    """Print how large the bounds on a map are."""
    from quietfix.diagrams.console.tables import Column, Table, print_table

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
            found, count = _percentiles(dataset, str(name), quantity)
            unit = dataset[quantity].attrs["units"]
            cells = [f"{q:.4g}" if count else "-" for q in found]
            table.add(str(name), f"{quantity} [{unit}]", str(count), *cells)
    print_table(table)
