"""How the clouds of particle filters are: unique ancestors, effective sample size, evidence."""

from __future__ import annotations

from typing import Any

import xarray as xr
from matplotlib.figure import Figure

from quietfix.diagrams.figures.style import grid, legend_outside, log_scale, looks, new_figure, time_label, title
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
    figure, panels = new_figure(height=10.0, rows=len(_PANELS), sharex=True)
    time, shown = dataset["time"].values, looks(dataset)
    for axes, (port, label) in zip(panels, _PANELS, strict=True):
        for name in names:
            _draw(axes, time, range_over_trials(dataset[f"{port}_{name}"][..., 0]), name, shown[name])
        axes.set(ylabel=label, xlim=(time[0], time[-1]))
        if port != "recent_evidence":
            log_scale(axes)
        grid(axes)
    panels[-1].axhline(LEAST_EVIDENCE, color="0.3", linewidth=1.2, linestyle=":")
    panels[-1].annotate(
        f"diverged below {LEAST_EVIDENCE:g}",
        (time[-1], LEAST_EVIDENCE),
        xytext=(-4, -4),
        textcoords="offset points",
        ha="right",
        va="top",
    )
    panels[-1].set_xlabel(time_label(dataset))
    figure.suptitle(title(dataset))
    legend_outside(figure, panels[0], title="median; range over trials")
    return figure


def _draw(axes: Any, time: Any, numbers: Any, name: str, look: Any) -> None:
    lowest, middle, highest = numbers
    axes.fill_between(time, lowest, highest, color=look.color, alpha=0.15, linewidth=0)
    axes.plot(time, middle, label=name, **look.line())
