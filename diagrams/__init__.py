"""Quietfix diagrams: scenarios, wiring, studies, metrics, bounds, figures and the command line."""

from __future__ import annotations

import importlib
from typing import Any

__all__ = [
    "Source",
    "System",
    "compare",
    "find",
    "load_scenario",
    "observe",
    "run_study",
    "sweep",
    "systems",
    "verify",
]

_WHERE = {
    "Source": "quietfix.diagrams.readers.data",
    "System": "quietfix.diagrams.assembly.system",
    "compare": "quietfix.diagrams.experiments.compare",
    "find": "quietfix.diagrams.assembly.find",
    "load_scenario": "quietfix.diagrams.commands.catalogue",
    "observe": "quietfix.diagrams.experiments.observability",
    "run_study": "quietfix.diagrams.studies.whole",
    "sweep": "quietfix.diagrams.experiments.sweep",
    "systems": "quietfix.diagrams.assembly.find",
    "verify": "quietfix.diagrams.verification.verify",
}


def __getattr__(name: str) -> Any:
    """Import on first use: the command line must answer before Drake is loaded."""
    if name in _WHERE:
        return getattr(importlib.import_module(_WHERE[name]), name)
    raise AttributeError(f"module 'quietfix.diagrams' has no attribute {name!r}")
