"""Contour maps of the bound after the pass."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from diagrams.figures.style import new_figure, save

__all__ = ["draw_gdop"]

_LEVELS = np.array([0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0, 20.0, 50.0, 100.0])  # km


def draw_gdop(dataset: xr.Dataset, folder: Path | str) -> list[Path]:
    """Draw the maps of position and height for every set of measurements.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `diagrams.gdop.gdop_map`.
    folder : path
        An existing folder.

    Returns
    -------
    list of Path
        ``gdop_position_SET.png`` and ``gdop_height_SET.png`` of every set, such as ``gdop_height_tdoa_phase_a.png``.
    """
    written = []
    for i, name in enumerate(dataset["set"].values):
        words = "_".join(re.findall(r"\w+", str(name)))
        for quantity in ("position", "height"):
            written.append(save(_draw(dataset, i, quantity), Path(folder) / f"gdop_{quantity}_{words}.png"))
    return written


def _draw(dataset: xr.Dataset, index: int, quantity: str) -> Figure:
    figure, axes = new_figure(height=10.5)
    chosen = dataset[quantity].isel(set=index)
    values = chosen.transpose("along", "cross").values / 1e3
    along, cross = dataset["along"].values, dataset["cross"].values
    levels = _levels(values)
    filled = axes.contourf(
        cross, along, values, levels, norm=LogNorm(levels[0], levels[-1]), cmap="viridis_r", alpha=0.75, extend="both"
    )
    lines = axes.contour(cross, along, values, levels, colors="black", linewidths=0.9)
    axes.clabel(lines, fmt=lambda level: f"{level:g}", fontsize=12)
    bar = figure.colorbar(filled, ax=axes, shrink=0.8, ticks=levels, format=lambda level, _: f"{level:g}")
    bar.set_label("bound [km]")
    bar.ax.minorticks_off()
    _draw_satellites(axes, dataset)
    axes.set_aspect("equal")
    axes.set(
        xlabel="across the track of satellite 0, right positive [km]",
        ylabel="along its track [km]",
        xlim=(cross[0], cross[-1]),
        ylim=(along[0], along[-1]),
    )
    attributes = dataset.attrs
    what = "position error (root of the trace)" if quantity == "position" else "height error"
    axes.set_title(
        f"Bound of the {what} after {attributes['duration_s']:g} s: {dataset['set'].values[index]}\n"
        f"process noise {attributes['acceleration_mps2']:g} m/s²; prior {attributes['prior']}\n"
        f"target {attributes['target']}; satellites above {attributes['minimum_elevation_deg']:g}° throughout",
        fontsize=12,
    )
    return figure


def _levels(values: np.ndarray) -> np.ndarray:
    """Return the levels that occur on the map, and one more on either side."""
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return _LEVELS
    low = max(0, int(np.searchsorted(_LEVELS, finite.min())) - 1)
    high = min(_LEVELS.size, int(np.searchsorted(_LEVELS, finite.max())) + 1)
    return _LEVELS[low : max(high, low + 2)]


def _draw_satellites(axes: Any, dataset: xr.Dataset) -> None:
    tracks = dataset["track"].transpose("satellite", "time", "axis").values
    middle = tracks.shape[1] // 2
    for i, track in enumerate(tracks):
        axes.plot(track[:, 1], track[:, 0], color="white", linewidth=4)
        axes.plot(track[:, 1], track[:, 0], color="#d55e00", linewidth=1.8, label="ground tracks" if i == 0 else None)
        axes.plot(
            track[middle, 1],
            track[middle, 0],
            "^",
            color="#d55e00",
            markeredgecolor="white",
            markersize=10,
            label="satellites at mid pass (filled: satellite 0)" if i == 0 else None,
            fillstyle="full" if i == 0 else "none",
        )
    axes.legend(loc="lower left", framealpha=0.9)
