"""Which of several motions an estimator believes in: the probabilities of the models."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from quietfix.diagrams.figures.shared.style import grid, legend_beside, looks_of, new_figure, time_label, title

__all__ = ["draw_models", "with_models"]

_PORT = "probabilities_"


def with_models(dataset: xr.Dataset) -> list[str]:
    """Return the estimators of which a result has the models' probabilities (they are kept with the measurements)."""
    names = [str(name) for name in dataset["estimator"].values]
    return [name for name in names if f"{_PORT}{name}" in dataset and dataset[f"{_PORT}{name}"].shape[-1] > 1]


def draw_models(dataset: xr.Dataset) -> Figure:
    """Draw the models' probabilities against time: mean and range of the middle half over the trials.

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
        If it has no estimator with several models.
    """
    names = with_models(dataset)
    if not names:
        raise ValueError("models: the result has none; an estimator of several and keep='measurements' are needed")
    figure, panels = new_figure(height=2.5 + 3.5 * len(names), rows=len(names), sharex=True, squeeze=False)
    time = dataset["time"].values
    for axes, name in zip(panels[:, 0], names, strict=True):
        values = dataset[f"{_PORT}{name}"]
        models = [str(model) for model in values[values.dims[-1]].values]
        seen = {model: look for group in looks_of(models) for model, look in group.items()}
        for j, model in enumerate(models):
            one = values.values[..., j]
            low, high = np.nanquantile(one, [0.25, 0.75], axis=0)
            axes.plot(time, np.nanmean(one, axis=0), label=model, **seen[model].line())
            axes.fill_between(time, low, high, color=seen[model].color, alpha=0.15, linewidth=0)
        axes.set(ylabel=f"probability, {name}", ylim=(-0.02, 1.02), xlim=(time[0], time[-1]))
        grid(axes)
        legend_beside(axes, title="mean; middle half of the trials")
    panels[-1, 0].set_xlabel(time_label(dataset))
    figure.suptitle(title(dataset))
    return figure
