"""What ``quietfix observe`` says: a table and a verdict per set of measurements, and what ``summary.json`` holds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from quietfix.diagrams.assembly.find import Found
from quietfix.diagrams.console.answer import asked_for_json
from quietfix.diagrams.console.tables import Column, Table, print_table
from quietfix.diagrams.console.terminal import say
from quietfix.diagrams.experiments.observability import Observability
from quietfix.diagrams.statistics.fisher_information import Spectrum
from quietfix.diagrams.studies.result_schema import SCHEMA_VERSION

__all__ = ["observability_summary", "print_observability"]


def print_observability(found: Sequence[Observability], title: str) -> None:
    """Print a table per set of measurements, and the verdict; with ``--json`` the summary has both."""
    if asked_for_json():
        return
    for one in found:
        s = one.spectrum
        table = Table(
            f"{title}: {', '.join(one.estimators)}",
            [
                *("time [s]", "rank", "better than prior", "condition"),
                *(Column("worst direction"), "its sigma", "variance left"),
            ],
            caption=f"rows {', '.join(one.rows)}; the prior's sigmas: {_counted(one)}"
            + (f"; ranges are from {one.platform}" if one.ranged else ""),
        )
        for k in _telling(s):
            worst = s.sigma[k, -1]
            table.add(
                f"{one.times[k]:g}",
                f"{s.rank[k]} of {len(one.components)}",
                f"{s.known[k]}",
                f"{s.condition[k]:.2g}" if np.isfinite(s.condition[k]) else "infinite",
                one.weakest_words(k),
                f"{worst:.3g} x prior" if np.isfinite(worst) else "infinite",
                f"{s.left[k, -1]:.3g}",
            )
        print_table(table)
        say(f"{', '.join(one.estimators)}: {one.verdict()}")


def _counted(one: Observability) -> str:
    parts = zip(one.components, one.prior_sigma, one.units, strict=True)
    return ", ".join(f"{name} {value:.4g} {unit}" for name, value, unit in parts)


def _telling(s: Spectrum, most: int = 9) -> Iterator[int]:
    """Yield the first and last epoch, and those at which rank or number of known directions changes."""
    counts = np.stack([s.rank, s.known], axis=-1)
    changes = np.flatnonzero(np.any(np.diff(counts, axis=0) != 0, axis=-1)) + 1
    yield from sorted({0, *changes[: most - 2].tolist(), len(counts) - 1})


def observability_summary(found: Sequence[Observability], system: Found) -> dict[str, Any]:
    """Return ``summary.json``: ``system``, ``time_s``, and under ``sets`` what `Observability.summary` returns."""
    return {
        "schema_version": SCHEMA_VERSION,
        "system": system.reference,
        "variant": system.variant,
        "time_s": [float(t) for t in found[0].times],
        "sets": [one.summary() for one in found],
    }
