"""Figures of a study; one file of functions per kind, `study_figures` draws them all.

May import: diagrams.figures.shared, diagrams.quantities, diagrams.statistics, systems.ambiguity, systems.filters.
"""

from __future__ import annotations

from pathlib import Path

import xarray as xr

from quietfix.diagrams.figures.consistency import draw_consistency
from quietfix.diagrams.figures.convergence import draw_convergence
from quietfix.diagrams.figures.errors import draw_error, draw_percentiles
from quietfix.diagrams.figures.ground import draw_ground, has_ground
from quietfix.diagrams.figures.models import draw_models, with_models
from quietfix.diagrams.figures.orbits import draw_orbits, has_orbits
from quietfix.diagrams.figures.particles import draw_particle_health, particle_filters
from quietfix.diagrams.figures.shared.curves import never_started
from quietfix.diagrams.figures.shared.style import save
from quietfix.diagrams.statistics.epochs import along
from quietfix.diagrams.statistics.tally import Ensemble

__all__ = ["study_figures"]


def study_figures(dataset: xr.Dataset, folder: Path | str, ensemble: Ensemble | None = None) -> list[Path]:
    """Draw and save the figures of a study as PNG.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result; bounds and ``platforms`` are drawn where it has them. Of one on disk no more than a chunk is
        read at once.
    folder : path
        An existing folder.
    ensemble : Ensemble, optional
        What is known of its trials already.

    Returns
    -------
    list of Path
        ``error_position``, ``error_height``, ``error_speed``, ``error_course``, ``error_bias``,
        ``percentiles_position``, ``nees``, ``nis``, ``ground`` or ``orbits``, ``particles``, ``models``,
        ``convergence``, all ``.png``; without those whose numbers the result does not have; of tracks of unequal length
        without ``ground``, ``orbits``, ``models`` and ``convergence``, which have no time in common.
    """
    target = Path(folder)
    if "estimator" not in dataset.coords:  # nothing is estimated
        return []
    tracks = along(dataset) == "epoch"
    known = ensemble or Ensemble(dataset)
    dataset, judged = known.dataset, known.judged("position")
    written = []
    idle = never_started(dataset, known.sums["not_started"])
    for quantity in ("position", "height", "speed", "course", "bias"):
        if quantity in known.quantities and known.judged(quantity):
            figure = draw_error(dataset, quantity, known.rmse(quantity), idle)
            written.append(save(figure, target / f"error_{quantity}.png"))
    if judged:
        figure = draw_percentiles(dataset, known.median_of_started, known.ninety_of_started, idle)
        written.append(save(figure, target / "percentiles_position.png"))
    for kind in ("nees", "nis"):
        if known.sums[f"{kind}_known"].any():
            written.append(save(draw_consistency(dataset, kind, known.sums), target / f"{kind}.png"))
    if judged and not tracks and has_ground(dataset):
        written.append(save(draw_ground(dataset), target / "ground.png"))
    if judged and not tracks and has_orbits(dataset):
        written.append(save(draw_orbits(dataset), target / "orbits.png"))
    if particle_filters(dataset):
        written.append(save(draw_particle_health(dataset), target / "particles.png"))
    if not tracks and with_models(dataset):
        written.append(save(draw_models(dataset), target / "models.png"))
    if judged and not tracks:
        figure = draw_convergence(dataset, known.rmse("position"), idle)
        written.append(save(figure, target / "convergence.png"))
    return written
