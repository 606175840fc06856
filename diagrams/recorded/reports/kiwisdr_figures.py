"""Figures of the KiwiSDR recordings."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import cycle
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from quietfix.diagrams.figures.shared.limits import reach
from quietfix.diagrams.figures.shared.style import COLOURS, grid, new_figure
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.earth.geodetic import ecef_to_geodetic, geodetic_to_ecef
from quietfix.systems.geometry.wave_path import WavePath

__all__ = ["draw_differences", "draw_map"]

Array = NDArray[np.float64]

_DASHES = ("-", (0, (6, 2)), (0, (2, 1.5)))


def draw_differences(title: str, times: Array, pairs: Mapping[str, tuple[Array, Array, float]]) -> Figure:
    """Draw the TDOAs of every pair against time, with what the samples let expect, and the true differences.

    Parameters
    ----------
    title : str
    times : ndarray, shape (times,)
        [s]
    pairs : mapping of str to (ndarray, ndarray, float)
        By the pair's name: TDOA, NaN where it is flagged, and its sigma (times,), and the true TDOA [s] or NaN.
    """
    figure, axes = new_figure(height=2 + 2 * len(pairs), rows=len(pairs), sharex=True)
    axes = np.atleast_1d(axes)
    for panel, (name, (tdoa, sigma, true)), colour in zip(axes, pairs.items(), cycle(COLOURS), strict=False):
        good = np.isfinite(tdoa)
        panel.errorbar(
            times[good],
            1e6 * tdoa[good],
            1e6 * sigma[good],
            fmt="o",
            color=colour,
            ms=5,
            capsize=2,
            lw=1.2,
            label=f"{name}, with the sigma predicted",
        )
        if np.isfinite(true):
            panel.axhline(1e6 * true, color="black", lw=1.4, ls=(0, (6, 3)), label="of the transmitter")
        panel.axhline(1e6 * np.median(tdoa[good]), color=colour, lw=1.2, label="median")
        panel.set_ylabel("TDOA [us]")
        grid(panel)
        panel.legend(frameon=False, ncols=3, loc="upper left")
        panel.margins(y=0.25)
    axes[-1].set_xlabel("time [s]")
    figure.suptitle(title)
    return figure


def _degrees(position: Array) -> Array:
    latitude, longitude, _ = ecef_to_geodetic(position)
    return np.degrees(np.stack([longitude, latitude]))


def _hyperbolas(
    axes: Any, stations: Array, differences: Mapping[str, tuple[tuple[int, int], float]], path: WavePath
) -> None:
    low, high = _degrees(stations).min(axis=1) - 3, _degrees(stations).max(axis=1) + 3
    longitude, latitude = np.meshgrid(np.linspace(low[0], high[0], 300), np.linspace(low[1], high[1], 300))
    place = geodetic_to_ecef(np.radians(latitude), np.radians(longitude), 0.0)
    delay = path.length(np.linalg.norm(place[..., None, :] - stations, axis=-1)) / SPEED_OF_LIGHT
    for i, (name, (pair, tdoa)) in enumerate(differences.items()):
        colour, dashes = COLOURS[i % len(COLOURS)], _DASHES[i // len(COLOURS) % len(_DASHES)]
        value = delay[..., pair[1]] - delay[..., pair[0]] - tdoa
        axes.contour(longitude, latitude, value, levels=[0.0], colors=[colour], linewidths=1.4, linestyles=[dashes])
        axes.plot([], [], color=colour, lw=1.4, ls=dashes, label=name)


def draw_map(
    title: str,
    receivers: Mapping[str, Array],
    differences: Mapping[str, tuple[tuple[int, int], float]],
    path: WavePath,
    mast: Array,
    fix: Array,
    around: tuple[Array, Array, Array],
) -> Figure:
    """Draw receivers and hyperbolas on a map, and the fixes around the mast, with the ellipse that is believed.

    Parameters
    ----------
    title : str
    receivers : mapping of str to ndarray, shape (3,)
        Where they are, Earth-fixed [m].
    differences : mapping of str to ((int, int), float)
        By the pair's name: its receivers and the TDOA of the second against the first [s].
    path : WavePath
        How the wave goes.
    mast, fix : ndarray, shape (3,)
        Where the transmitter is (NaN: nobody knows), and where it was found, Earth-fixed [m].
    around : (ndarray, ndarray, ndarray)
        East and north of the transmitter, or the fix [m]: the fix of each window (windows, 2), that of all (2,) and its
        covariance (2, 2).
    """
    figure, (left, right) = new_figure(height=7, columns=2)
    stations = np.array(list(receivers.values()))
    _hyperbolas(left, stations, differences, path)
    places = _degrees(stations)
    left.plot(*places, "^", color="black", ms=9, label="receivers")
    for name, place in zip(receivers, places.T, strict=True):
        left.annotate(name, place, xytext=(7, 6), textcoords="offset points")
    known = bool(np.isfinite(mast).all())
    origin = "transmitter" if known else "fix"
    if known:
        left.plot(*_degrees(mast), "+", color="black", ms=16, mew=2, label=origin)
        right.plot(0, 0, "+", color="black", ms=18, mew=2, label=origin)
    left.plot(*_degrees(fix), "o", fillstyle="none", color="#cc79a7", ms=11, mew=2, label="fix")
    left.set(xlabel="longitude [deg]", ylabel="latitude [deg]", title="hyperbolas of the median differences")
    left.set_aspect(1 / np.cos(np.radians(places[1].mean())))
    grid(left)
    left.legend(loc="lower left", framealpha=0.9)

    singly, end, covariance = around[0] / 1e3, around[1] / 1e3, around[2] / 1e6
    right.plot(singly[:, 0], singly[:, 1], ".", color="0.55", ms=8, label="each window alone")
    right.plot(end[0], end[1], "o", fillstyle="none", color="#cc79a7", ms=11, mew=2, label="fix of all windows")
    values, vectors = np.linalg.eigh(covariance)
    angle = np.linspace(0, 2 * np.pi, 100)
    ring = 2 * np.sqrt(np.maximum(values, 0)) * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    ellipse = ring @ vectors.T + end
    right.plot(*ellipse.T, color="#cc79a7", lw=1.6, label="its ellipse of two sigma")
    edge, out = reach(singly)
    more = f" ({out} of {len(singly)} windows beyond the edge, marked on it)" if out else ""
    right.set(xlabel=f"east of the {origin} [km]", ylabel=f"north of the {origin} [km]", title=f"fixes{more}")
    if edge is None:
        right.set_aspect("equal", adjustable="datalim")
        right.margins(0.12)
    else:
        edge = max(edge, 1.2 * float(np.abs(ellipse).max()))
        far = np.abs(singly).max(axis=-1)
        at = singly[far > edge] * (edge / far[far > edge, None])
        right.plot(*at.T, "D", color="0.55", fillstyle="none", ms=6, clip_on=False, zorder=5)
        right.set(xlim=(-edge, edge), ylim=(-edge, edge), aspect="equal")
    grid(right)
    right.legend(loc="best", framealpha=0.9)
    figure.suptitle(title)
    return figure
