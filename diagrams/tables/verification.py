"""What a verification tells: a table of requirements, and how many hold."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from quietfix.diagrams.console.tables import Column, Styled, Table
from quietfix.diagrams.statistics.sequential import FAILS, HOLDS, UNDECIDED, WORDS

__all__ = ["limit_words", "readable", "verification_counts", "verification_table"]

_STYLES = {WORDS[HOLDS]: "green", WORDS[FAILS]: "red", WORDS[UNDECIDED]: "yellow"}


def readable(value: float | None) -> str:
    """Return a number with as many digits as mean something."""
    if value is None:
        return "not finite"
    if not math.isfinite(value):
        return str(value)
    return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def limit_words(least: float | None, most: float | None) -> str:
    """Return what is allowed, in words."""
    if least is not None and most is not None:
        return f"{readable(least)} to {readable(most)}"
    return f">= {readable(least)}" if least is not None else f"<= {readable(most)}"


def verification_table(told: Mapping[str, Any]) -> Table:
    """Return the table of a ``verification.json``: one row per requirement."""
    looks = ", ".join(map(str, told["looks"]))
    chances = sorted({f"{1 - (one['confidence'] or 0):.2g}" for one in told["requirements"]})
    table = Table(
        f"{told['file']}: {told['system']}, seed {told['seed']}",
        [
            *map(Column, ("requirement", "estimator", "metric")),
            *("estimate", "interval", Column("limit"), Column("verdict"), "trials"),
        ],
        caption=f"Looks at {looks} trials. A verdict is wrong with probability {' or '.join(chances)} at most, all"
        " looks together; the interval is that of the look that decided.",
    )
    for one in told["requirements"]:
        table.add(
            one["name"] + (f" ({one['case']})" if one["case"] else ""),
            one["estimator"],
            one["metric"],
            readable(one["estimate"]),
            f"{readable(one['lower'])} to {readable(one['upper'])}",
            f"{limit_words(one['at_least'], one['at_most'])} {one['unit'] or ''}",
            Styled(one["verdict"], _STYLES[one["verdict"]]),
            str(one["trials"]),
        )
    return table


def verification_counts(told: Mapping[str, Any]) -> str:
    """Return how many requirements hold, fail, and are undecided."""
    words = [one["verdict"] for one in told["requirements"]]
    holds, fails, undecided = (words.count(WORDS[verdict]) for verdict in (HOLDS, FAILS, UNDECIDED))
    return f"{holds} of {len(words)} hold, {fails} fail, {undecided} undecided"
