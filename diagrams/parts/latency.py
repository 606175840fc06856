"""How late measurements come: scenario fields."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from quietfix.diagrams.assembly.late import Late, LateRows
from quietfix.systems.documented import choice, number

__all__ = ["LateBelief", "LatencyOptions", "late_of"]


@dataclass
class LatencyOptions:
    """How late the measurements of a sensor come."""

    mean: float = number("[s]; 0: at once", 0.0, at_least=0, at_most=1e6)
    jitter: float = number(
        "uniform within so much of the mean, drawn anew for each measurement [s]; at most the mean",
        0.0,
        at_least=0,
        at_most=1e6,
    )


@dataclass
class LateBelief:
    """What the estimators make of measurements that come late."""

    times: str = choice(
        "made: they go back to when each was made; arrival: they take it for one of the instant at which it comes",
        "made",
        ("made", "arrival"),
    )
    buffer_s: float | None = number(
        "how far back they can go [s], what is older is left out and counted; null: as far as the latest one needs",
        None,
        at_least=0,
    )


def late_of(
    sensors: Mapping[str, tuple[Sequence[str], LatencyOptions]],
    belief: LateBelief,
    stream: Sequence[str],
    apart: bool = False,
) -> Late | None:
    """Return what is late; None: nothing.

    Parameters
    ----------
    sensors : mapping of str to (rows, LatencyOptions)
        By the field of the latency.
    belief : LateBelief
    stream : sequence of str
        All rows in their order.
    apart : bool
        Whether each row comes by itself, with a jitter of its own; else those of a sensor come together.
    """
    late = [
        LateRows(together, one.mean, one.jitter, where)
        for where, (rows, one) in sensors.items()
        if one.mean or one.jitter  # a jitter without a mean is refused
        for together in ([[row] for row in rows] if apart else [list(rows)])
    ]
    return Late(late, list(stream), belief.times == "made", belief.buffer_s) if late else None
