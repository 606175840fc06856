"""The figures of a study, drawn when it has run and whenever they are asked for again."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import xarray as xr

if TYPE_CHECKING:
    from quietfix.diagrams.statistics.tally import Ensemble

__all__ = ["draw_diagram", "illustrate"]


def illustrate(dataset: xr.Dataset, study: Any, folder: Path, known: Ensemble) -> None:
    """Draw figures and diagram of a study.

    Parameters
    ----------
    dataset : xarray.Dataset
        Its result.
    study : Study
    folder : Path
        Where they go.
    known : Ensemble
        What is known of its trials.
    """
    from quietfix.diagrams.figures import study_figures

    study_figures(dataset, folder, known)
    draw_diagram(study, folder)


def draw_diagram(study: Any, folder: Path) -> None:
    """Draw the block diagram of a study."""
    from quietfix.diagrams.assembly.drawing import draw

    header = f"{study.request.system}: {study.request.trials} trials"
    draw(study.picture, folder / "diagram.svg", header, study.probe.notes(study.request.trials))
