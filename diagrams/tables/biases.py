"""What estimators have made of biases: a table below that of the study."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from quietfix.diagrams.console.tables import Column, Table, three_digits

__all__ = ["bias_table"]

_WRITTEN = {"s": (1e9, "ns"), "rad": (57.29577951308232, "deg")}
"""As the biases are written in a scenario."""


def bias_table(estimators: Mapping[str, Any]) -> Table | None:
    """Return the table of the biases that are estimated, from the part ``estimators`` of ``summary.json``.

    None where there are none.
    """
    rows = [(name, bias, of) for name, row in estimators.items() for bias, of in row.get("biases", {}).items()]
    if not rows:
        return None
    table = Table(
        "biases at the end",
        [Column("estimator"), Column("bias"), Column("unit"), "mean", "spread", "stated"],
        keys=2,
        caption="Mean and standard deviation over the trials of what is estimated, and the standard deviation that the "
        "estimator states.",
    )
    for name, bias, of in rows:
        scale, unit = _WRITTEN.get(of["unit"], (1.0, of["unit"]))
        numbers = (None if of[key] is None else scale * of[key] for key in ("mean", "spread", "sigma"))
        table.add(name, bias, unit, *map(three_digits, numbers))
    return table
