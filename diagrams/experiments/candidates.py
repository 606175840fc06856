"""Who takes part in a comparison: estimators of the scenario, those asked for, and those offered to all systems."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from pydrake.systems.framework import DiagramBuilder

from quietfix.diagrams.assembly.build import build
from quietfix.diagrams.assembly.find import Found, find
from quietfix.diagrams.assembly.lineup import select_estimators, smoothers_of
from quietfix.diagrams.assembly.model import Model
from quietfix.diagrams.assembly.system import System
from quietfix.systems.registry import ESTIMATORS

__all__ = ["STANDARD", "Lineup", "line_up"]


STANDARD = ("ekf", "iekf", "ukf", "pf")
"""Estimators of the registry that every system is asked to take."""

_LIGHT: Mapping[str, Mapping[str, Any]] = {"pf": {"particles": 4000}, "pf_sir": {"particles": 4000}}
"""Options of those that cost a thousand times as much as a Kalman filter, where nobody asked for them by name."""
_ALL, _DEFAULT = "all", "default"


@dataclass(frozen=True)
class Lineup:
    """Who takes part, in which scenario, and why others do not.

    Attributes
    ----------
    scenario : dataclass
        With the estimators that were added.
    names : list of str
        The estimators side by side.
    model : Model
        What the scenario declares, whoever takes part.
    left_out : mapping of str to str
        Estimators that the system cannot take, and what it says.
    lighter : mapping of str to mapping
        Options other than their own defaults, of estimators that were added unasked.
    """

    scenario: Any
    names: list[str]
    model: Model
    left_out: Mapping[str, str] = field(default_factory=dict)
    lighter: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


def line_up(system: str | System | Found, scenario: Any, wanted: Sequence[str] | None = None) -> Lineup:
    """Return which estimators run on a system.

    Parameters
    ----------
    system : str or System
        The system.
    scenario : dataclass
        Not changed.
    wanted : sequence of str, optional
        Names of the scenario or the registry, ``package.module:Class``, ``default``: the scenario's and those of
        `STANDARD`, or ``all``: the scenario's and the whole registry. Of the last two the system takes what it can; a
        name that is asked for must fit. ``smoothed`` adds the smoothers of all that can be smoothed.

    Raises
    ------
    UserError
        For a name that is not known.
    """
    scenario = copy.deepcopy(scenario)
    found = find(system)
    model = found.model(scenario)
    names: list[str] = []
    left_out: dict[str, str] = {}
    lighter: dict[str, Mapping[str, Any]] = {}
    smooth = "smoothed" in (wanted or ()) and "smoothed" not in scenario.estimators
    for asked in [one for one in wanted or () if not (smooth and one == "smoothed")] or [_DEFAULT]:
        if asked not in (_DEFAULT, _ALL):
            names += select_estimators(scenario, [asked])
            continue
        names += list(scenario.estimators)
        for extra in STANDARD if asked == _DEFAULT else ESTIMATORS:
            if extra in ("custom", *names) or extra not in ESTIMATORS:
                continue
            reason = _refusal(found, model, scenario, extra)
            if reason is None:
                names.append(extra)
                if extra in _LIGHT:
                    lighter[extra] = _LIGHT[extra]
                    scenario.estimators[extra] = dataclasses.replace(scenario.estimators[extra], **_LIGHT[extra])
            else:
                left_out[extra] = reason
    if smooth:
        names += smoothers_of(scenario, names)
    return Lineup(scenario, list(dict.fromkeys(names)), model, left_out, lighter)


def _refusal(found: Found, model: Model, scenario: Any, name: str) -> str | None:
    """Add an estimator of the registry to the scenario; return what the system says against it, or None."""
    select_estimators(scenario, [name])
    try:
        with found.blaming(scenario.estimators, name):
            build(model, DiagramBuilder(), {name: scenario.estimators[name]}, 1)
    except ValueError as error:
        del scenario.estimators[name]
        return str(error).removeprefix(f"{name}: ")
    return None
