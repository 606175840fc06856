"""Any estimator on any system: who is better, by how much, and whether that could be chance.

All estimators sit in one diagram on one stream of measurements, so every comparison is paired.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from quietfix.diagrams.assembly.find import Found, find
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.experiments.candidates import Lineup, line_up
from quietfix.diagrams.experiments.compared_study import ComparedStudy
from quietfix.diagrams.experiments.comparison import comparison_statistics
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.studies.recordings import only_simulated
from quietfix.diagrams.studies.whole import join

__all__ = ["compare", "prepare"]

_MOST = 200_000  # epochs times trials for which such a one is added unasked: some minutes
_EPOCHS = 500  # the mean over time and the curves are taken over at most about so many


def prepare(
    system: str | System | Found,
    *,
    variant: str | None = None,
    scenario: Any = None,
    estimators: Sequence[str] | None = None,
    trials: int | None = None,
    seed: int = 0,
    set: Sequence[str] | None = None,
    chunk: int | None = None,
    threads: int = 1,
    keep: str = "estimates",
) -> tuple[ComparedStudy, Lineup]:
    """Return the study of a comparison, ready to run, and who takes part; arguments as in `compare`.

    `keep`: what of each trial, as of `Study`.
    """
    found = find(system, variant)
    if found.system.recording is not None and not found.system.recording.truth:
        only_simulated(found, "compare")
    scenario = found.system.resolve(found.variant, scenario, set)
    chosen = line_up(found, scenario, estimators)
    recording = chosen.model.recorded is not None
    if chosen.model.recorded is not None and not chosen.model.recorded.truth:
        only_simulated(found, "compare", scenario)
    if isinstance(trials, int) and trials == 1 and not recording:
        raise UserError("trials: 1 is not allowed; intervals over trials need at least 2")
    if not chosen.names:
        raise UserError("estimators: none is given; at least one is needed")
    epochs = len(chosen.model.clock.ticks(chosen.model.duration))
    count = 1 if recording else 100 if trials is None else trials
    if epochs * count > _MOST and chosen.lighter:
        too_many = f"{epochs} epochs of {count} trials would take it very long; --estimator asks for it all the same"
        chosen = dataclasses.replace(
            chosen,
            names=[one for one in chosen.names if one not in chosen.lighter],
            left_out={**chosen.left_out, **dict.fromkeys(chosen.lighter, too_many)},
            lighter={},
        )
    study = ComparedStudy(
        found,
        scenario=chosen.scenario,
        estimators=chosen.names,
        trials=trials,
        seed=seed,
        chunk=chunk,
        threads=threads,
        keep=keep,
        every=1 if recording else math.ceil(epochs / _EPOCHS),
        model=chosen.model,
    )
    return study, chosen


def compare(
    system: str | System | Found,
    *,
    variant: str | None = None,
    scenario: Any = None,
    estimators: Sequence[str] | None = None,
    trials: int | None = None,
    seed: int = 0,
    set: Sequence[str] | None = None,
    at: float | None = None,
    confidence: float = 0.95,
    threads: int = 1,
) -> dict[str, Any]:
    """Run estimators side by side on one stream of measurements and compare them.

    Parameters
    ----------
    system, variant, scenario, trials, seed, set, threads
        As of `quietfix.diagrams.run_study`; at least 2 trials, unless it is a recording.
    estimators : sequence of str, optional
        See `line_up`; by default those of the scenario and those of `STANDARD` that the system takes.
    at : float, optional
        When the RMSE and the NEES are taken [s]; by default at the end.
    confidence : float
        Of every interval, and of the statement who is best.

    Returns
    -------
    dict
        What ``comparison.json`` holds, see `comparison_statistics`.

    Raises
    ------
    UserError
        For whatever cannot be run.
    """
    study, chosen = prepare(
        system,
        variant=variant,
        scenario=scenario,
        estimators=estimators,
        trials=trials,
        seed=seed,
        set=set,
        threads=threads,
    )
    dataset = join(list(study.chunks()))
    return comparison_statistics(dataset, study, chosen, at=at, confidence=confidence)
