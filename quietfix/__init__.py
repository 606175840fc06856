"""Quietfix: passive location and tracking as Drake block diagrams.

`quietfix.systems` holds models, filters and the Drake blocks around them; `quietfix.diagrams` wires them to systems and
runs studies of them.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from quietfix.diagrams.assembly.find import find
    from quietfix.diagrams.assembly.system import System
    from quietfix.diagrams.commands.catalogue import load_scenario
    from quietfix.diagrams.experiments.compare import compare
    from quietfix.diagrams.experiments.observability import observe
    from quietfix.diagrams.experiments.sweep import sweep
    from quietfix.diagrams.studies.whole import run_study
    from quietfix.diagrams.verification.verify import verify

__all__ = ["System", "compare", "find", "load_scenario", "observe", "run_study", "sweep", "verify"]


def __dir__() -> list[str]:
    """Return what is there, what is not imported yet, too: for completion."""
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> Any:
    """Import on first use: the command line must answer before Drake is loaded."""
    if name in __all__:
        return getattr(importlib.import_module("quietfix.diagrams"), name)
    raise AttributeError(f"module 'quietfix' has no attribute {name!r}")
