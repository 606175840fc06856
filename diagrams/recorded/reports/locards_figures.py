"""Figures of LocaRDS."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from quietfix.diagrams.figures.style import grid, new_figure
from quietfix.systems.earth.geodetic import ecef_to_geodetic

if TYPE_CHECKING:
    from quietfix.diagrams.recorded.reports.locards_report import LocardsReport

__all__ = ["draw_errors", "draw_map", "draw_track_errors"]

Array = NDArray[np.float64]

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")  # of the estimators in turn
_CRUISE = 230.0  # m/s


def draw_errors(result: LocardsReport) -> Figure:
    """Draw which share of the messages has a fix that is no further off than so much.

    Left: as recorded; right, if there is that trial: with faults. A curve ends below 100 % where messages have no fix.
    """
    trials = result.trials
    figure, axes = new_figure(columns=trials, sharey=True, squeeze=False)
    scores = result.all
    fault, percent = result.settings.fault_m / 1e3, 100 * result.settings.fault_share
    titles = ("as recorded", f"{fault:g} km added at one receiver in {percent:g} % of the messages")
    for trial, (panel, title) in enumerate(zip(axes[0], titles, strict=False)):
        for who, which, width, dash in (
            ("all aircraft", scores.known, 2.6, "-"),
            ("at least 5 messages", scores.known & scores.many, 1.6, (0, (5, 2))),
        ):
            for k, label in reversed(list(enumerate(result.labels))):
                error, share = _distribution(scores.horizontal[k, which, trial])
                color = _COLOURS[k % len(_COLOURS)]
                panel.step(error, share, where="post", color=color, lw=width, ls=dash, label=f"{who}, {label}")
        panel.set(xscale="log", xlim=(3, 3e4), ylim=(0, 101), title=title, xlabel="horizontal error [m]")
        panel.axhline(90, color="0.6", lw=0.8)
        grid(panel)
    axes[0, 0].set_ylabel("messages with a fix at least so good [%]")
    figure.suptitle(f"LocaRDS: {result.names[0]} against the position that the aircraft reports")
    axes[0, 0].legend(loc="lower right", frameon=False)
    return figure


def _distribution(error: Array) -> tuple[Array, Array]:
    """Return sorted errors and the share of all messages, those without a fix included [%]."""
    found = np.sort(error[np.isfinite(error)])
    return found, 100 * np.arange(1, found.size + 1) / max(error.size, 1)


def draw_track_errors(result: LocardsReport) -> Figure:
    """Draw the errors along and across the course, of the first estimate, as recorded.

    A position that is reported late lies behind the aircraft: the error is then ahead, and the scale at the top says
    how late at 230 m/s.
    """
    scores = result.all
    ahead, aside = scores.along[0, :, 0], scores.across[0, :, 0]
    figure, (left, right) = new_figure(columns=2)
    left.plot(aside, ahead, ".", color=_COLOURS[0], ms=5, alpha=0.6)
    left.axhline(0, color="0.4", lw=0.8)
    left.axvline(0, color="0.4", lw=0.8)
    left.set(xlim=(-450, 450), ylim=(-450, 450), aspect="equal")
    left.set(xlabel="across the course, to the right [m]", ylabel="along the course, ahead [m]")
    grid(left)
    edges = np.arange(-450, 451, 25.0)
    for part, color, label in ((ahead, _COLOURS[0], "along"), (aside, "0.55", "across")):
        right.hist(part[np.isfinite(part)], edges, histtype="step", lw=2.2, color=color, label=label)
    right.set(xlabel="error [m]", ylabel="messages")
    late = right.secondary_xaxis("top", functions=(lambda m: m / _CRUISE, lambda s: s * _CRUISE))
    late.set_xlabel(f"age of the reported position at {_CRUISE:g} m/s [s]")
    right.legend(frameon=False)
    grid(right)
    figure.suptitle(f"LocaRDS: error along and across the course, {result.labels[0]}")
    return figure


def draw_map(result: LocardsReport) -> Figure:
    """Draw receivers, and where messages were sent, coloured by the error of the first estimate, as recorded."""
    figure, axes = new_figure(height=8)
    scores = result.all
    tracks = [track for data in result.sets for track in data.tracks]
    stations = np.concatenate([track.platforms[..., :3].reshape(-1, 3) for track in tracks])
    latitude, longitude, _ = ecef_to_geodetic(np.unique(stations[np.isfinite(stations).all(axis=-1)], axis=0))
    receivers = np.degrees(np.stack([longitude, latitude]))
    place, error = np.degrees(scores.place[:, ::-1].T), scores.horizontal[0, :, 0]
    missed = scores.known & ~np.isfinite(error)
    silent = np.degrees(scores.fix[~scores.known, ::-1].T)
    dots = axes.scatter(*place, c=error, s=16, cmap="viridis_r", norm=LogNorm(10, 1000))
    if silent.size:
        axes.plot(*silent, "o", color="0.5", fillstyle="none", ms=5, label="fix; no position is reported")
    axes.plot(*place[:, missed], "x", color="#d55e00", ms=8, mew=2, label="message without a fix")
    axes.plot(*receivers, "^", color="black", ms=8, label="receiver")
    axes.set(xlabel="longitude [deg]", ylabel="latitude [deg]")
    # most is in one region; what is far from it would shrink it to a spot
    shown = np.concatenate([place, silent], axis=1)
    shown = shown[:, np.isfinite(shown).all(axis=0)]
    (west, east), (south, north) = np.percentile(shown if shown.size else receivers, [10, 90], axis=1).T
    stretch = 1 / np.cos(np.radians((south + north) / 2))
    half = 0.8 * (north - south) + 0.7
    axes.set(ylim=((south + north) / 2 - half, (south + north) / 2 + half), aspect=stretch)
    axes.set_xlim((west + east) / 2 - 1.3 * stretch * half, (west + east) / 2 + 1.3 * stretch * half)
    grid(axes)
    axes.legend(loc="lower right")
    bar = figure.colorbar(dots, ax=axes, extend="both", label="horizontal error [m]")
    bar.set_ticks([10, 30, 100, 300, 1000], labels=["10", "30", "100", "300", "1000"])
    figure.suptitle("LocaRDS: where the messages were sent, and how far off the fixes are")
    return figure
