"""Quietfix diagrams: scenarios, wiring, studies, metrics, bounds, figures and the command line."""

from __future__ import annotations

import importlib
from typing import Any

__all__ = ["Source", "System", "find", "load_scenario", "run_study", "systems"]

_WHERE = {
    "Source": "diagrams.readers.data",
    "System": "diagrams.assembly.system",
    "find": "diagrams.assembly.find",
    "load_scenario": "diagrams.commands.catalogue",
    "run_study": "diagrams.studies.whole",
    "systems": "diagrams.assembly.find",
}


def __getattr__(name: str) -> Any:
    """Import on first use: the command line must answer before Drake is loaded."""
    if name in _WHERE:
        return getattr(importlib.import_module(_WHERE[name]), name)
    raise AttributeError(f"module 'diagrams' has no attribute {name!r}")
