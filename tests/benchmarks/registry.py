"""Which comparisons there are; a new one is its file and one line here."""

from __future__ import annotations

import importlib
from collections.abc import Callable

from tests.benchmarks.harness import Size
from tests.benchmarks.report import Section

__all__ = ["COMPARISONS", "comparison"]

COMPARISONS: dict[str, str] = {
    "iterated_filter": "tests.benchmarks.iterated_filter:compare",
    "diagram_overhead": "tests.benchmarks.diagram_overhead:compare",
    "diagram_step": "tests.benchmarks.diagram_step:compare",
    "one_linearisation": "tests.benchmarks.one_linearisation:compare",
    "rocket_filter": "tests.benchmarks.rocket_filter:compare",
    "ensemble_size": "tests.benchmarks.ensemble_size:compare",
    "bearings_only": "tests.benchmarks.bearings_only:compare",
    "particle_filter": "tests.benchmarks.particle_filter:compare",
    "satellite_ranging": "tests.benchmarks.satellite_ranging:compare",
    "cross_ambiguity": "tests.benchmarks.cross_ambiguity:compare",
    "workers": "tests.benchmarks.workers:compare",
}
"""Function of each comparison, ``compare(size: Size) -> Section``, as ``module:function``."""


def comparison(name: str) -> Callable[[Size], Section]:
    """Return the function of that comparison; its peers are imported only now."""
    module, _, function = COMPARISONS[name].partition(":")
    return getattr(importlib.import_module(module), function)
