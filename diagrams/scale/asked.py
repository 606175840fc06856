"""The study that a command line, an earlier result or another process asks for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

from quietfix.diagrams.assembly.find import Found
from quietfix.diagrams.console.terminal import say
from quietfix.diagrams.experiments.compared_study import ComparedStudy
from quietfix.diagrams.studies.study import Study

__all__ = ["built", "for_a_page", "writes_itself"]

_PAGE_BYTES = 1e9  # of a result that keeps covariances although nobody has asked for them

S = TypeVar("S", bound=Study)


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


def for_a_page(make: Callable[[str], S]) -> S:
    """Return a study that keeps what a page of it shows: covariances, too, where the result stays below 1 GB.

    Parameters
    ----------
    make : callable
        What is kept -> the study.
    """
    study = make("covariance")
    size = study.trial_bytes * study.request.trials
    if size <= _PAGE_BYTES or study.recorded is not None:
        return study
    say(
        f"--report: with the covariances of all trials the result would take {size / 1e9:.1f} GB, so "
        "they are left out and the page has no ellipses; --keep covariance keeps them"
    )
    return make("estimates")
