"""Quietfix diagrams: scenarios, wiring, studies, metrics, bounds, figures and the command line."""

from __future__ import annotations

import importlib
from typing import Any

__all__ = ["Source", "System", "find", "load_scenario", "run_study", "systems"]

_WHERE = {
    "Source": "quietfix.diagrams.readers.data",
    "System": "quietfix.diagrams.assembly.system",
    "find": "quietfix.diagrams.assembly.find",
    "load_scenario": "quietfix.diagrams.commands.catalogue",
    "run_study": "quietfix.diagrams.studies.whole",
    "systems": "quietfix.diagrams.assembly.find",
}


def __getattr__(name: str) -> Any:
    """Import on first use: the command line must answer before Drake is loaded."""
    if name in _WHERE:
        return getattr(importlib.import_module(_WHERE[name]), name)
    raise AttributeError(f"module 'quietfix.diagrams' has no attribute {name!r}")
