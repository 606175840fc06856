"""Names of what can be swapped; a new estimator is its file and one line here."""

from __future__ import annotations

import importlib
import sys
import traceback
from functools import reduce
from operator import or_
from pathlib import Path
from typing import Any

__all__ = ["ESTIMATORS", "SMOOTHED", "blamed", "estimator_options", "in_one_line", "lines_of", "object_at"]

ESTIMATORS: dict[str, str] = {
    "iekf": "quietfix.systems.options.iekf:Iekf",
    "ekf": "quietfix.systems.options.ekf:Ekf",
    "ukf": "quietfix.systems.options.ukf:Ukf",
    "pf": "quietfix.systems.options.pf:Pf",
    "pf_sir": "quietfix.systems.options.pf_sir:PfSir",
    "iekf_hypotheses": "quietfix.systems.options.iekf_hypotheses:IekfHypotheses",
    "mgekf": "quietfix.systems.options.mgekf:Mgekf",
    "range_bank": "quietfix.systems.options.bearings.range_bank:RangeBank",
    "crossing": "quietfix.systems.options.bearings.crossing:Crossing",
    "ml": "quietfix.systems.options.bearings.ml:Ml",
    "ukf_unaugmented": "quietfix.systems.options.beacon:UkfUnaugmented",
    "ukf_monitored": "quietfix.systems.options.beacon:UkfMonitored",
    "ra": "quietfix.systems.options.ranging.ra:Ra",
    "ra_paper": "quietfix.systems.options.ranging.ra:RaPaper",
    "bank": "quietfix.systems.options.ranging.bank:Bank",
    "imm": "quietfix.systems.options.interacting.imm:Imm",
    "batch": "quietfix.systems.options.batch:Batch",
    "custom": "quietfix.systems.options.custom:Custom",
}
"""Options class of each estimator, as ``module:Class``."""

SMOOTHED = "quietfix.systems.options.smoothed:Smoothed"
"""Options class of what is made of another estimator; it has no name of its own."""


def in_one_line(error: BaseException) -> str:
    """Return kind and text of an error in a user's code."""
    try:
        text = str(error)
    except Exception:  # the class of the error may be the user's, too
        text = ""
    return " ".join(f"{type(error).__name__}: {text}".split()).removesuffix(":")


def lines_of(path: str, error: BaseException) -> list[tuple[str, int | None]]:
    """Return where an error was on its way in the file of the class ``package.module:Class``, the innermost last."""
    file = getattr(sys.modules.get(path.partition(":")[0]), "__file__", None)
    frames = traceback.extract_tb(error.__traceback__)
    return [(Path(file).name, frame.lineno) for frame in frames if file and frame.filename == file]


def blamed(path: str, error: BaseException, method: str = "") -> str:
    """Return in one line what a user's class (or a method of it) raised, and where in its file."""
    lines = lines_of(path, error)
    where = f" ({lines[-1][0]}, line {lines[-1][1]})" if lines else ""
    return f"{path}{method and '.'}{method} failed with {in_one_line(error)}{where}"


def object_at(path: str) -> Any:
    """Import what ``package.module:Name`` names.

    Raises
    ------
    ValueError
        If the module or the name does not exist, or the module fails while it is imported.
    """
    module, _, name = path.partition(":")
    if not module or not name:
        raise ValueError(f"class: {path!r} is not allowed; package.module:Class")
    try:
        found = importlib.import_module(module)
    except ImportError as error:
        raise ValueError(f"class: {path} cannot be imported ({error})") from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # whatever a user's file does while it is read, sys.exit too
        raise ValueError(f"class: {path} cannot be imported ({in_one_line(error)})") from error
    try:
        return getattr(found, name)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a module may have a __getattr__ of its own
        raise ValueError(f"class: module {module} has no {name}") from error


def estimator_options() -> Any:
    """Return the union of the options classes of all registered estimators; each class name is a YAML tag."""
    return reduce(or_, (object_at(path) for path in (*ESTIMATORS.values(), SMOOTHED)))
