"""Estimates as lines of JSON, in the columns of ``estimates.csv``."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from quietfix.diagrams.live.bench import Bench
from quietfix.diagrams.live.lines import Moment as Zero
from quietfix.diagrams.live.track import Outcome
from quietfix.diagrams.readers.stamps import write_stamps
from quietfix.diagrams.writers.estimates import state_columns
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.signals import components_of

__all__ = ["lines_of"]


def lines_of(outcome: Outcome, bench: Bench, zero: Zero | None, counts: Mapping[str, int]) -> list[str]:
    """Return a line for each estimator.

    Parameters
    ----------
    outcome : Outcome
    bench : Bench
    zero : (int, float), optional
        t = 0 in seconds of TAI since 1970: lines have dates.
    counts : mapping of str to int
        What else a line says.
    """
    head: dict[str, Any] = {} if zero is None else {"time": write_stamps(zero, np.array([outcome.time]))[0]}
    head |= {"time_s": outcome.time, "target": outcome.target}
    tail: dict[str, Any] = {"rows": outcome.rows, **counts}
    if outcome.revised:
        tail["revised"] = True
    found = []
    for name, told in outcome.told.items():
        states = _states(bench.estimators[name], told.estimate, told.covariance, bench.model.axes.geodetic)
        nis = {"nis": _known(told.nis), "nis_dof": int(told.nis_dof), "lost": told.lost}
        found.append(json.dumps({**head, "estimator": name, **states, **nis, **tail}, allow_nan=False))
    return found


def _states(block: Estimator, estimate: Any, covariance: Any, geodetic: bool) -> dict[str, float | None]:
    components = components_of(block.motion.reported)
    names, units = [one.name for one in components], [one.unit for one in components]
    columns = state_columns(estimate[None], covariance[None], names, units, geodetic)
    return {name: _known(float(column[0])) for name, column in columns.items()}


def _known(value: float) -> float | None:
    return value if np.isfinite(value) else None
