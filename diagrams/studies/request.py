"""What a study is asked for, checked."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from quietfix.diagrams.assembly.build import Assembly
from quietfix.diagrams.assembly.companions import companions
from quietfix.diagrams.assembly.find import Found
from quietfix.diagrams.assembly.lineup import select_estimators
from quietfix.diagrams.assembly.recorded import Recorded
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.schema.scenario import dump
from quietfix.diagrams.studies.result_schema import SCHEMA_VERSION

__all__ = [
    "KEEP",
    "Request",
    "attributes_of",
    "check_numbers",
    "check_threads",
    "count_of",
    "estimators_of",
    "quietfix_version",
]

KEEP = ("estimates", "covariance", "measurements", "all")
"""What of each trial is kept; errors, NEES and NIS always are."""

_MOST_THREADS = 256


@dataclass(frozen=True)
class Request:
    """What a study was asked for, after checking."""

    system: str
    variant: str | None
    scenario: Any
    estimators: list[str]
    trials: int
    first_trial: int
    seed: int
    keep: str
    every: int
    chunk: int | None
    threads: int = 1


def check_numbers(trials: int | None, first_trial: int, seed: int, every: int, chunk: int | None) -> None:
    """Refuse numbers that are none, or out of range; see `quietfix.diagrams.studies.whole.run_study`."""
    for what, value, least in (
        ("trials", 1 if trials is None else trials, 1),
        ("first-trial", first_trial, 0),
        ("seed", seed, 0),
        ("every", every, 1),
        ("chunk", 1 if chunk is None else chunk, 1),
    ):
        if not isinstance(value, int | np.integer) or isinstance(value, bool) or not least <= value < 2**53:
            raise UserError(f"{what}: {value!r} is not allowed; a whole number from {least} to {2**53 - 1}")


def check_threads(threads: int, trials: int) -> int:
    """Return a number of threads; refuse one that is none, or more than the trials that they share."""
    most = min(trials, _MOST_THREADS)
    if not isinstance(threads, int | np.integer) or isinstance(threads, bool) or not 1 <= threads <= most:
        allowed = "1" if most == 1 else f"a whole number from 1 to {most}"
        why = "; they share the trials" if most == trials else ""
        raise UserError(f"threads: {threads!r} is not allowed; {allowed}{why}")
    return int(threads)


def estimators_of(found: Found, scenario: Any, estimators: Sequence[str] | None) -> list[str]:
    """Return the names of the estimators to run; a system may estimate nothing."""
    if found.system.estimates:
        return select_estimators(scenario, estimators)
    if estimators or scenario.estimators:
        name = [*(estimators or ()), *scenario.estimators][0]
        raise UserError(f"estimators: {name} is not allowed for {found.title}; nothing is estimated there")
    return []


def count_of(found: Found, recorded: Recorded | None, trials: int | None, first: int) -> int:
    """Return how many trials to run: 100, or the tracks of a recording."""
    if recorded is None:
        return 100 if trials is None else int(trials)
    tracks = len(recorded.tracks)
    count = tracks - first if trials is None else int(trials)
    if not first < first + count <= tracks:
        held = "a recording of 1 track" if tracks == 1 else f"a recording of {tracks} tracks"
        raise UserError(
            f"trials: {count} from {first} on {'is' if count == 1 else 'are'} not allowed; {found.title} is {held}, "
            "and each is a trial"
        )
    return count


def quietfix_version() -> str:
    """Return the version of the package."""
    try:
        return version("quietfix")
    except PackageNotFoundError:
        return "not installed"


def attributes_of(request: Request, found: Found, wired: Assembly) -> dict[str, Any]:
    """Return what a result needs to be run again from itself: of a request and the diagram that it makes."""
    recorded = wired.model.recorded
    return {
        "schema_version": SCHEMA_VERSION,
        "system": request.system,
        "variant": request.variant or "",
        **found.attributes,
        **({"system_files": json.dumps(files)} if (files := companions(found, request.scenario)) else {}),
        "seed": request.seed,
        "first_trial": request.first_trial,
        "trials": request.trials,
        **({} if recorded is None else {"tracks": len(recorded.tracks)}),
        "keep": request.keep,
        "every": request.every,
        "version": quietfix_version(),
        "frame": wired.model.axes.name,
        "note": wired.note,
        "divergence_m": wired.model.divergence,
        "scenario": dump(request.scenario, comments=False),
        **({} if wired.model.convergence is None else {"convergence_m": wired.model.convergence}),
    }
