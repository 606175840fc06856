"""The study that a command line, an earlier result or another process asks for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from quietfix.diagrams.assembly.find import Found
from quietfix.diagrams.experiments.compared_study import ComparedStudy
from quietfix.diagrams.studies.study import Study

__all__ = ["built", "writes_itself"]


def writes_itself(found: Found) -> bool:
    """Return whether measurements are what a recording gives anyway."""
    return not found.system.estimates


def built(found: Found | str, options: Mapping[str, Any], write: bool, command: str = "run") -> Study:
    """Return a study.

    Parameters
    ----------
    found : Found or str
    options : mapping
        As of `Study`.
    write : bool
        Whether its measurements are written: what is measured, before phases are resolved, is kept then, too.
    command : str
        What it is for; a comparison also notes what its estimators cost.
    """
    if command == "compare":
        return ComparedStudy(found, **options)
    study = Study(found, **options)
    if write and not writes_itself(study.found) and "raw" in study.probe.bus:
        signals = {**study.model.signals, "raw": "raw"}
        study = Study(found, **options, model=replace(study.model, signals=signals))
    return study
