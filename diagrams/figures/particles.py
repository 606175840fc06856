"""How the clouds of particle filters are: unique ancestors, effective sample size, evidence."""

from __future__ import annotations

from typing import Any

import xarray as xr
from matplotlib.figure import Figure

from quietfix.diagrams.figures.shared.style import (
    grid,
    legend_above,
    legend_beside,
    log_scale,
    looks,
    looks_of,
    new_figure,
    time_label,
    title,
)
from quietfix.diagrams.statistics.tally import range_over_trials
from quietfix.systems.filters.particle.health import LEAST_EVIDENCE

__all__ = ["draw_particle_health", "particle_filters"]

_PANELS = (
    ("ancestors", "unique ancestors"),
    ("effective_particles", "effective particles"),
    ("recent_evidence", "recent evidence"),
)


def particle_filters(dataset: xr.Dataset) -> list[str]:
    """Return the estimators of which a result has the health of the clouds (it is kept with the measurements)."""
    names = [str(name) for name in dataset["estimator"].values]
    return [name for name in names if all(f"{port}_{name}" in dataset for port, _ in _PANELS)]


def draw_particle_health(dataset: xr.Dataset) -> Figure:
    """Draw ancestors, effective sample size and evidence against time: median and range over the trials.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result, ``keep="measurements"`` or more.

    Returns
    -------
    matplotlib.figure.Figure

    Raises
    ------
    ValueError
        If it has no particle filter's health.
    """
    names = particle_filters(dataset)
    if not names:
        raise ValueError("particle health: the result has none; a particle filter and keep='measurements' are needed")
    every = looks(dataset)
    # with a colour for each in every figure; otherwise with colours of their own
    shown = [{name: every[0][name] for name in names}] if len(every) == 1 else looks_of(names)
    figure, columns = new_figure(10.0, len(_PANELS), len(shown), sharex=True, sharey="row", squeeze=False)
    time = dataset["time"].values
    for group, panels in zip(shown, columns.T, strict=True):
        for axes, (port, label) in zip(panels, _PANELS, strict=True):
            for name, look in group.items():
                _draw(axes, time, range_over_trials(dataset[f"{port}_{name}"][..., 0]), name, look)
            axes.set(ylabel=label, xlim=(time[0], time[-1]) if time[-1] > time[0] else None)
            if port != "recent_evidence":
                log_scale(axes)
            grid(axes)
        _threshold(panels[-1], time[-1])
        panels[-1].set_xlabel(time_label(dataset))
        place = legend_above if len(shown) > 1 else legend_beside
        place(panels[0], title="median; range over trials")
    figure.suptitle(title(dataset))
    return figure


def _threshold(axes: Any, end: float) -> None:
    axes.axhline(LEAST_EVIDENCE, color="0.3", linewidth=1.2, linestyle=":")
    axes.annotate(
        f"diverged below {LEAST_EVIDENCE:g}",
        (end, LEAST_EVIDENCE),
        xytext=(-4, -4),
        textcoords="offset points",
        ha="right",
        va="top",
    )


def _draw(axes: Any, time: Any, numbers: Any, name: str, look: Any) -> None:
    lowest, middle, highest = numbers
    axes.fill_between(time, lowest, highest, color=look.color, alpha=0.15, linewidth=0)
    axes.plot(time, middle, label=name, **look.line())
