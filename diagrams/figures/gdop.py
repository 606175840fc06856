"""Contour maps of the bound after the pass."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from scipy.interpolate import PchipInterpolator, make_interp_spline
from scipy.ndimage import distance_transform_edt

from quietfix.diagrams.figures.shared.labels import name_places
from quietfix.diagrams.figures.shared.style import new_figure, save
from quietfix.diagrams.figures.shared.ticks import plain_ticks

__all__ = ["draw_gdop"]


def _series(steps: Sequence[float]) -> np.ndarray:
    return np.concatenate([np.array(steps) * 10.0**power for power in range(-6, 7)])


_LEVELS = _series([1.0, 1.5, 2.0, 3.0, 5.0, 7.0])
_FINE = _series([1.0, 1.2, 1.4, 1.6, 1.8, 2.0, 2.3, 2.6, 3.0, 3.5, 4.0, 4.5, 5.0, 6.0, 7.0, 8.0, 9.0])
_TRACK, _POINT = "#d55e00", "#a0407c"
_MARKER: dict[str, Any] = {"markeredgecolor": "white", "markersize": 10}
_SMOOTHED = 4  # points along a side, from which on contours are smoothed
_TIMES, _FINEST = 8, 800  # how many times finer, and points along a side at most
_SEEN = 0.499  # share of the points around that are seen
_WIDEST = 115  # characters of a title
_FEW, _MOST = 7, 16  # levels on a map: with fewer finer ones, with more every other one
_TITLES = {"position": "position error (root of the trace)", "height": "height error", "velocity": "velocity error"}


def draw_gdop(dataset: xr.Dataset, folder: Path | str) -> list[Path]:
    """Draw a map of every quantity for every set of measurements.

    Parameters
    ----------
    dataset : xarray.Dataset
        From `quietfix.diagrams.maps.bounds.map_bounds`.
    folder : path
        An existing folder.

    Returns
    -------
    list of Path
        ``gdop_QUANTITY_SET.png``, such as ``gdop_height_tdoa_phase_a.png``.
    """
    written = []
    for i, name in enumerate(dataset["set"].values):
        words = "_".join(re.findall(r"\w[\w+-]*", str(name)))
        for quantity in dataset.attrs["quantities"]:
            written.append(save(_draw(dataset, i, quantity), Path(folder) / f"gdop_{quantity}_{words}.png"))
    return written


def _draw(dataset: xr.Dataset, index: int, quantity: str) -> Figure:
    attributes = dataset.attrs
    vertical, horizontal = (dataset[attributes[name]].values for name in ("vertical", "horizontal"))
    tall = np.ptp(vertical) / np.ptp(horizontal) if attributes["equal"] and np.ptp(horizontal) > 0 else 0.6
    figure, axes = new_figure(height=float(np.clip(10.5 * tall, 5.5, 10.5)))
    values = dataset[quantity].isel(set=index).transpose(attributes["vertical"], attributes["horizontal"]).values
    finite = values[np.isfinite(values)]
    unit = dataset[quantity].attrs["units"]
    unit = "km" if unit == "m" and (finite.size == 0 or np.median(finite) >= 300) else unit
    values = values / (1e3 if unit == "km" else 1.0)
    levels = _levels(values)
    fine = _smooth(vertical, horizontal, values)
    filled = axes.contourf(
        *fine,
        levels,
        norm=LogNorm(levels[0], levels[-1]),
        cmap="viridis_r",
        alpha=0.75,
        extend="both",
    )
    lines = axes.contour(*fine, levels, colors="black", linewidths=0.9)
    axes.clabel(lines, fmt=lambda level: f"{level:g}", fontsize=12)
    bar = figure.colorbar(filled, ax=axes, shrink=0.8, ticks=levels, format=lambda level, _: f"{level:g}")
    bar.set_label(f"bound [{unit}]")
    bar.ax.minorticks_off()
    _draw_tracks(figure, axes, dataset)
    if attributes["equal"]:
        axes.set_aspect("equal")
    axes.set(
        xlabel=attributes["horizontal_label"],
        ylabel=attributes["vertical_label"],
        xlim=(horizontal[0], horizontal[-1]),
        ylim=(vertical[0], vertical[-1]),
    )
    plain_ticks(axes)
    lines = [
        f"Bound of the {_TITLES[quantity]} after {attributes['duration_s']:g} s: {dataset['set'].values[index]}"
        + _everywhere(values, levels, unit),
        f"process noise {attributes['noise']}; prior {attributes['prior']}",
        f"target: {attributes['target']}",
    ]
    axes.set_title("\n".join(fill(line, _WIDEST) for line in lines), fontsize=12)
    _name(figure, axes, dataset)
    return figure


def _smooth(vertical: np.ndarray, horizontal: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return x, y and values of a finer grid, between whose points contours have no corners.

    The logarithm is interpolated by monotone cubics, which make no peak that the points do not have; half a step beyond
    the last point that is seen the map ends.
    """
    known = np.isfinite(values) & (values > 0)
    if min(values.shape) < _SMOOTHED or known.sum() < _SMOOTHED**2:
        return horizontal, vertical, values
    # points that are not seen take the value of the nearest one that is, so that the edge can be crossed
    nearest = distance_transform_edt(~known, return_distances=False, return_indices=True)
    log = np.log(values[tuple(nearest)])
    times = max(1, min(_TIMES, _FINEST // max(values.shape)))
    y, x = (_finer(along, times) for along in (vertical, horizontal))
    fine = PchipInterpolator(horizontal, PchipInterpolator(vertical, log, axis=0)(y), axis=1)(x)
    share = make_interp_spline(horizontal, make_interp_spline(vertical, known.astype(float), 1)(y), 1, axis=1)(x)
    return x, y, np.where(share > _SEEN, np.exp(fine), np.nan)


def _finer(along: np.ndarray, times: int) -> np.ndarray:
    return np.interp(np.arange((along.size - 1) * times + 1) / times, np.arange(along.size), along)


def _name(figure: Figure, axes: Any, dataset: xr.Dataset) -> None:
    """Write the names of curves, at half time, and places, where they have names."""
    tracks, points = dataset["track"].values, dataset["point"].values
    for names, places, color in (("curve", tracks[len(tracks) // 2 :][:1], _TRACK), ("mark", points[None], _POINT)):
        texts = dataset[names].values
        if texts.dtype.kind == "U" and texts.size:
            at = dict(zip(map(str, texts), places[0][:, ::-1], strict=True))
            name_places(figure, axes, at, color)


def _everywhere(values: np.ndarray, levels: np.ndarray, unit: str) -> str:
    """Return how large the bound is where no contour says so, for it is about the same all over the map."""
    finite = values[np.isfinite(values)]
    if finite.size == 0 or np.any((levels > finite.min()) & (levels < finite.max())):
        return ""
    return f", {finite.min():.4g} to {finite.max():.4g} {unit} everywhere"


def _levels(values: np.ndarray) -> np.ndarray:
    """Return the levels that occur on the map, and one more on either side."""
    finite = values[np.isfinite(values) & (values > 0)]
    if finite.size == 0:
        return _LEVELS[(_LEVELS >= 0.1) & (_LEVELS <= 100)]
    # a few extreme points are worth no level
    least, most = np.percentile(finite, [0.5, 99.5])
    levels = _between(_LEVELS, least, most)
    if levels.size < _FEW:
        levels = _between(_FINE, least, most)
    return levels if levels.size <= _MOST else levels[:: -(-levels.size // _MOST)]


def _between(levels: np.ndarray, least: float, most: float) -> np.ndarray:
    low = max(0, int(np.searchsorted(levels, least)) - 1)
    high = min(levels.size, int(np.searchsorted(levels, most)) + 1)
    return levels[low : max(high, low + 2)]


def _draw_tracks(figure: Figure, axes: Any, dataset: xr.Dataset) -> None:
    named: set[str] = set()

    def once(label: str) -> str | None:
        first = label not in named
        named.add(label)
        return label if first else None

    for track, label in zip(np.moveaxis(dataset["track"].values, 1, 0), dataset.attrs["track_labels"], strict=True):
        if not _on_the_map(track, dataset):
            continue
        moves = np.ptp(track, axis=0).max() > 0
        if moves:
            axes.plot(track[:, 1], track[:, 0], color="white", linewidth=4)
            axes.plot(track[:, 1], track[:, 0], color=_TRACK, linewidth=1.8, label=once(label))
        shown = once("at half time" if moves else label)
        place = track[len(track) // 2]
        axes.plot(place[1], place[0], "^", color=_TRACK, label=shown, zorder=4, **_MARKER)
    points = dataset["point"].values
    if points.size:
        label = dataset.attrs["points_label"]
        axes.plot(points[:, 1], points[:, 0], "s", color=_POINT, label=label, zorder=4, **_MARKER)
    if axes.get_legend_handles_labels()[1]:
        # beside the map, which it would hide
        figure.legend(loc="outside lower center", ncols=3, frameon=False)


def _on_the_map(track: np.ndarray, dataset: xr.Dataset) -> bool:
    """Return whether any of a curve (steps, 2) is on the map."""
    sides = [dataset[dataset.attrs[name]].values for name in ("vertical", "horizontal")]
    inside = [(side.min() <= along) & (along <= side.max()) for side, along in zip(sides, track.T, strict=True)]
    return bool(np.any(inside[0] & inside[1]))
