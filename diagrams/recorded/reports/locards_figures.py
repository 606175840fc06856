"""Figures of LocaRDS."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray

from quietfix.diagrams.figures.shared.style import grid, new_figure
from quietfix.systems.earth.geodetic import ecef_to_geodetic

__all__ = ["draw_errors", "draw_map", "draw_track_errors"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")  # of the estimators in turn
_CRUISE = 230.0  # m/s


def draw_errors(error: Array, many: Mask, labels: Sequence[str], titles: Sequence[str], who: str) -> Figure:
    """Draw which share of the messages has a fix that is no further off than so much.

    A curve ends below 100 % where messages have no fix.

    Parameters
    ----------
    error : ndarray, shape (estimates, messages, trials)
        Horizontal [m]; NaN where there is no fix.
    many : ndarray of bool, shape (messages,)
        Those of aircraft with at least five.
    labels, titles : sequence of str
        Of the estimates, and of the trials.
    who : str
        The first estimator.
    """
    figure, axes = new_figure(columns=len(titles), sharey=True, squeeze=False)
    for trial, (panel, title) in enumerate(zip(axes[0], titles, strict=True)):
        for which, chosen, width, dash in (
            ("all aircraft", np.ones_like(many), 2.6, "-"),
            ("at least 5 messages", many, 1.6, (0, (5, 2))),
        ):
            for k, label in reversed(list(enumerate(labels))):
                found, share = _distribution(error[k, chosen, trial])
                color = _COLOURS[k % len(_COLOURS)]
                panel.step(found, share, where="post", color=color, lw=width, ls=dash, label=f"{which}, {label}")
        panel.set(xscale="log", xlim=(3, 3e4), ylim=(0, 101), title=title, xlabel="horizontal error [m]")
        panel.axhline(90, color="0.6", lw=0.8)
        grid(panel)
    axes[0, 0].set_ylabel("messages with a fix at least so good [%]")
    figure.suptitle(f"LocaRDS: {who} against the position that the aircraft reports")
    axes[0, 0].legend(loc="lower right", frameon=False)
    return figure


def _distribution(error: Array) -> tuple[Array, Array]:
    """Return sorted errors and the share of all messages, those without a fix included [%]."""
    found = np.sort(error[np.isfinite(error)])
    return found, 100 * np.arange(1, found.size + 1) / max(error.size, 1)


def draw_track_errors(ahead: Array, aside: Array, label: str) -> Figure:
    """Draw the errors of an estimate along and across the course (messages,) [m].

    A position that is reported late lies behind the aircraft: the error is then ahead, and the scale at the top says
    how late at 230 m/s.
    """
    figure, (left, right) = new_figure(columns=2)
    left.plot(aside, ahead, ".", color=_COLOURS[0], ms=5, alpha=0.6)
    left.axhline(0, color="0.4", lw=0.8)
    left.axvline(0, color="0.4", lw=0.8)
    left.set(xlim=(-450, 450), ylim=(-450, 450), aspect="equal")
    left.set(xlabel="across the course, to the right [m]", ylabel="along the course, ahead [m]")
    grid(left)
    edges = np.arange(-450, 451, 25.0)
    for part, color, which in ((ahead, _COLOURS[0], "along"), (aside, "0.55", "across")):
        right.hist(part[np.isfinite(part)], edges, histtype="step", lw=2.2, color=color, label=which)
    right.set(xlabel="error [m]", ylabel="messages")
    late = right.secondary_xaxis("top", functions=(lambda m: m / _CRUISE, lambda s: s * _CRUISE))
    late.set_xlabel(f"age of the reported position at {_CRUISE:g} m/s [s]")
    right.legend(frameon=False)
    grid(right)
    figure.suptitle(f"LocaRDS: error along and across the course, {label}")
    return figure


def draw_map(stations: Array, place: Array, error: Array, fixes: Array) -> Figure:
    """Draw receivers, and where messages were sent, coloured by the error of an estimate.

    Parameters
    ----------
    stations : ndarray, shape (receivers, 3)
        Earth-fixed [m].
    place : ndarray, shape (messages, 2)
        Latitude and longitude that the aircraft reported [rad].
    error : ndarray, shape (messages,)
        Horizontal [m]; NaN where there is no fix.
    fixes : ndarray, shape (other messages, 2)
        Latitude and longitude [rad] found for messages of aircraft that report no position.
    """
    figure, axes = new_figure(height=8)
    latitude, longitude, _ = ecef_to_geodetic(stations)
    receivers = np.degrees(np.stack([longitude, latitude]))
    place, silent, missed = np.degrees(place[:, ::-1].T), np.degrees(fixes[:, ::-1].T), ~np.isfinite(error)
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
