"""Any estimator on any system: who is better, by how much, and whether that could be chance.

All estimators sit in one diagram on one stream of measurements, so every comparison is paired.
"""

from __future__ import annotations

import copy
import dataclasses
import math
import platform
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder
from scipy.stats import binomtest

from diagrams.assembly.build import Assembly, build
from diagrams.assembly.find import Found, find
from diagrams.assembly.lineup import select_estimators
from diagrams.assembly.model import Model
from diagrams.assembly.system import System
from diagrams.bootstrap import Interval, PairedBootstrap, Replicates, best_of, interval
from diagrams.consistency import chi_square_band
from diagrams.errors import UserError
from diagrams.json_numbers import json_numbers
from diagrams.metrics import causal, diverged, median, not_started
from diagrams.score import Score
from diagrams.starting import why_not_started
from diagrams.state_errors import errors
from diagrams.states import shared
from diagrams.stopwatch import Stopwatch
from diagrams.study import Study, join
from systems.registry import ESTIMATORS

__all__ = [
    "STANDARD",
    "ComparedStudy",
    "Lineup",
    "compare",
    "entry",
    "line_up",
    "machine",
    "nearest_epoch",
    "nees_entry",
    "prepare",
    "statistics",
]

Array = NDArray[np.float64]

STANDARD = ("ekf", "iekf", "ukf", "pf")
"""Estimators of the registry that every system is asked to take."""

_LIGHT: Mapping[str, Mapping[str, Any]] = {"pf": {"particles": 4000}, "pf_sir": {"particles": 4000}}
"""Options of those that cost a thousand times as much as a Kalman filter, where nobody asked for them by name."""

_FINER = 16  # times as many resamples where they do not decide who is best
_MOST = 200_000  # epochs times trials for which such a one is added unasked: some minutes
_ALL, _DEFAULT = "all", "default"
_EPOCHS = 500  # the mean over time and the curves are taken over at most about so many


# ------------------------------------------------------------------------------------------- who takes part


@dataclass(frozen=True)
class Lineup:
    """Who takes part, in which scenario, and why others do not.

    Attributes
    ----------
    scenario : dataclass
        With the estimators that were added.
    names : list of str
        The estimators side by side.
    model : Model
        What the scenario declares, whoever takes part.
    left_out : mapping of str to str
        Estimators that the system cannot take, and what it says.
    lighter : mapping of str to mapping
        Options other than their own defaults, of estimators that were added unasked.
    """

    scenario: Any
    names: list[str]
    model: Model
    left_out: Mapping[str, str] = field(default_factory=dict)
    lighter: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


def line_up(system: str | System | Found, scenario: Any, wanted: Sequence[str] | None = None) -> Lineup:
    """Return which estimators run on a system.

    Parameters
    ----------
    system : str or System
        The system.
    scenario : dataclass
        Not changed.
    wanted : sequence of str, optional
        Names of the scenario or the registry, ``package.module:Class``, ``default``: the scenario's and those of
        `STANDARD`, or ``all``: the scenario's and the whole registry. Of the last two the system takes what it can; a
        name that is asked for must fit.

    Raises
    ------
    UserError
        For a name that is not known.
    """
    scenario = copy.deepcopy(scenario)
    found = find(system)
    model = found.model(scenario)
    names: list[str] = []
    left_out: dict[str, str] = {}
    lighter: dict[str, Mapping[str, Any]] = {}
    for asked in wanted or [_DEFAULT]:
        if asked not in (_DEFAULT, _ALL):
            names += select_estimators(scenario, [asked])
            continue
        names += list(scenario.estimators)
        for extra in STANDARD if asked == _DEFAULT else ESTIMATORS:
            if extra in ("custom", *names) or extra not in ESTIMATORS:
                continue
            reason = _refusal(found, model, scenario, extra)
            if reason is None:
                names.append(extra)
                if extra in _LIGHT:
                    lighter[extra] = _LIGHT[extra]
                    scenario.estimators[extra] = dataclasses.replace(scenario.estimators[extra], **_LIGHT[extra])
            else:
                left_out[extra] = reason
    return Lineup(scenario, list(dict.fromkeys(names)), model, left_out, lighter)


def _refusal(found: Found, model: Model, scenario: Any, name: str) -> str | None:
    """Add an estimator of the registry to the scenario; return what the system says against it, or None."""
    select_estimators(scenario, [name])
    try:
        with found.blaming(scenario.estimators, name):
            build(model, DiagramBuilder(), {name: scenario.estimators[name]}, 1)
    except ValueError as error:
        del scenario.estimators[name]
        return str(error).removeprefix(f"{name}: ")
    return None


# --------------------------------------------------------------------------------------------------- running


class ComparedStudy(Study):
    """A study that also notes what each estimator costs and how many states are scored.

    Parameters
    ----------
    system : str or System
        As of `diagrams.run_study`.
    **options
        As of `diagrams.study.Study`.

    Attributes
    ----------
    stopwatches : dict of str to Stopwatch
        Of the estimators that run.
    """

    stopwatches: dict[str, Stopwatch]

    def wire(self, trials: int) -> tuple[Assembly, DiagramBuilder, dict[str, Score]]:
        """See `Study.wire`."""
        wired, builder, scores = super().wire(trials)
        self.stopwatches = {name: Stopwatch(block) for name, block in wired.estimators.items()}
        return wired, builder, scores

    @property
    def states(self) -> dict[str, int]:
        """How many states the NEES is about, by estimator."""
        truth = self.probe.truth_names
        return {name: len(shared(block.motion.names, truth)) for name, block in self.probe.estimators.items()}

    @property
    def feedback(self) -> list[str]:
        """Predictions that go back into the measurements, ``estimator -> block``."""
        return [f"{source} -> {target}" for source, target in self.probe.dashed]

    @property
    def costs(self) -> dict[str, float]:
        """Processor time of one step of one trial [us] by estimator, so far."""
        return {name: watch.microseconds for name, watch in self.stopwatches.items()}


def prepare(
    system: str | System | Found,
    *,
    variant: str | None = None,
    scenario: Any = None,
    estimators: Sequence[str] | None = None,
    trials: int = 100,
    seed: int = 0,
    set: Sequence[str] | None = None,
) -> tuple[ComparedStudy, Lineup]:
    """Return the study of a comparison, ready to run, and who takes part; arguments as in `compare`."""
    found = find(system, variant)
    if isinstance(trials, int) and trials == 1:
        raise UserError("trials: 1 is not allowed; intervals over trials need at least 2")
    scenario = found.system.resolve(found.variant, scenario, set)
    chosen = line_up(found, scenario, estimators)
    if not chosen.names:
        raise UserError("estimators: none is given; at least one is needed")
    epochs = len(chosen.model.clock.ticks(chosen.model.duration))
    if epochs * trials > _MOST and chosen.lighter:
        too_many = f"{epochs} epochs of {trials} trials would take it very long; --estimator asks for it all the same"
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
        every=math.ceil(epochs / _EPOCHS),
        model=chosen.model,
    )
    return study, chosen


def compare(
    system: str | System | Found,
    *,
    variant: str | None = None,
    scenario: Any = None,
    estimators: Sequence[str] | None = None,
    trials: int = 100,
    seed: int = 0,
    set: Sequence[str] | None = None,
    at: float | None = None,
    confidence: float = 0.95,
) -> dict[str, Any]:
    """Run estimators side by side on one stream of measurements and compare them.

    Parameters
    ----------
    system, variant, scenario, trials, seed, set
        As of `diagrams.run_study`; at least 2 trials.
    estimators : sequence of str, optional
        See `line_up`; by default those of the scenario and those of `STANDARD` that the system takes.
    at : float, optional
        When the RMSE and the NEES are taken [s]; by default at the end.
    confidence : float
        Of every interval, and of the statement who is best.

    Returns
    -------
    dict
        What ``comparison.json`` holds, see `statistics`.

    Raises
    ------
    UserError
        For whatever cannot be run.
    """
    study, chosen = prepare(
        system, variant=variant, scenario=scenario, estimators=estimators, trials=trials, seed=seed, set=set
    )
    dataset = join(list(study.chunks()))
    return statistics(dataset, study, chosen, at=at, confidence=confidence)


# ------------------------------------------------------------------------------------------------ statistics


def nearest_epoch(times: Array, at: float | None) -> int:
    """Return the index of the epoch nearest to a time, by default of the last.

    Raises
    ------
    UserError
        If the time is outside the run.
    """
    if at is None:
        return len(times) - 1
    if not times[0] <= at <= times[-1]:
        raise UserError(f"at: {at:g} is not allowed; {times[0]:g} to {times[-1]:g} s")
    return int(np.argmin(np.abs(times - at)))


def statistics(
    dataset: xr.Dataset,
    study: ComparedStudy,
    chosen: Lineup,
    at: float | None = None,
    confidence: float = 0.95,
    resamples: int = 9999,
) -> dict[str, Any]:
    """Return the comparison of a study's estimators.

    Parameters
    ----------
    dataset : xarray.Dataset
        The study's result.
    study : ComparedStudy
        For costs and sizes.
    chosen : Lineup
        For what was left out.
    at, confidence
        See `compare`.
    resamples : int
        Of the bootstrap.

    Returns
    -------
    dict
        Numbers as ``{"value", "low", "high"}`` where they have an interval, None where undefined or not finite.
        ``estimators.NAME``: ``rmse_position_m`` (at the time), ``armse_position_m`` (mean over time of the RMSE),
        ``median_position_m``, ``bound_position_m``, ``efficiency`` (RMSE over bound) and whether it ``is`` one
        (``efficiency_means_something``: the truth moves as the filter believes), ``nees_per_state`` with
        ``nees_band`` and ``nees_verdict``, ``diverged``, ``not_started`` (in no RMSE; in ``best``
        infinite where another one started), ``cost_us``. ``best.METRIC``: who has the smallest, whether significantly,
        the runner-up, and the ratio of every other one to it.
    """
    if not 0 < confidence < 1:
        raise UserError(f"confidence: {confidence} is not allowed; between 0 and 1")
    times = np.asarray(dataset["time"].values, dtype=float)
    epoch = nearest_epoch(times, at)
    draws = PairedBootstrap(dataset.sizes["trial"], resamples)
    names = [str(name) for name in dataset["estimator"].values]
    costs = study.costs
    rows: dict[str, dict[str, Any]] = {}
    replicates: list[Replicates] = []
    squared: list[Array] = []
    never = not_started(dataset)
    nobody = never.all("estimator").values
    for name in names:
        one, out = dataset.sel(estimator=[name]), never.sel(estimator=name).values
        error = errors(one)["position"].where(~never.sel(estimator=[name]))
        squares = np.square(error.values[0])
        found = draws.apply(squares, lambda means: _two(means, epoch))
        # Who does not start where another does is not the better for it: there its error is infinite.
        alone = (out & ~nobody)[:, None]
        squared.append(np.where(alone, np.inf, squares))
        replicates.append(draws.apply(squared[-1], lambda means: _two(means, epoch)) if alone.any() else found)
        both = interval(found, confidence)
        row: dict[str, Any] = {"causal": causal(dataset, name)}
        row["rmse_position_m"], row["armse_position_m"] = (entry(both, i) for i in range(2))
        row["median_position_m"] = json_numbers(median(error).values[0, epoch])
        row |= _efficiency(one, Interval(*(part[0] for part in both)), epoch)
        lost_now = np.isinf(error.values[0, :, epoch])
        row |= nees_entry(one["nees"].values[0, :, epoch], lost_now, study.states[name], draws, confidence)
        lost = int((diverged(one).values[0] & ~out).sum())
        row["not_started"] = int(out.sum())
        tail = binomtest(lost, draws.trials).proportion_ci(confidence, "exact")
        row["diverged"], row["diverged_rate"] = lost, {"low": float(tail.low), "high": float(tail.high)}
        row["cost_us"] = json_numbers(costs[name])
        rows[name] = row

    def finer() -> list[Replicates]:
        more = dataclasses.replace(draws, resamples=_FINER * resamples)
        return [more.apply(one, lambda means: _two(means, epoch)) for one in squared]

    return {
        "system": dataset.attrs["system"],
        "variant": dataset.attrs["variant"] or None,
        "seed": int(dataset.attrs["seed"]),
        "trials": draws.trials,
        "version": dataset.attrs["version"],
        "machine": machine(),
        "time_s": float(times[epoch]),
        "confidence": confidence,
        "resamples": resamples,
        "correction": "Bonferroni over the comparisons of the best with all others",
        "batch": min(study.chunk, draws.trials),
        "feedback": study.feedback,
        "note": dataset.attrs.get("note", ""),
        "not_started": why_not_started(dataset, {name: row["not_started"] for name, row in rows.items()}),
        "left_out": dict(chosen.left_out),
        "lighter": {name: dict(options) for name, options in chosen.lighter.items()},
        "estimators": rows,
        "best": {
            metric: _best(names, np.array([rows[n]["causal"] for n in names]), replicates, finer, column, confidence)
            for column, metric in enumerate(("rmse_position_m", "armse_position_m"))
        },
    }


def _two(means: Array, epoch: int) -> Array:
    """Return RMSE at an epoch and its mean over time from mean squares (..., time)."""
    curve = np.sqrt(means)
    known = ~np.isnan(curve)
    with np.errstate(invalid="ignore"):
        average = np.where(known, curve, 0.0).sum(axis=-1) / known.sum(axis=-1)
    return np.stack([curve[..., epoch], average], axis=-1)


def _best(
    names: Sequence[str],
    is_causal: NDArray[np.bool_],
    replicates: Sequence[Replicates],
    finer: Callable[[], Sequence[Replicates]],
    column: int,
    confidence: float,
) -> dict[str, Any] | None:
    """Return who has the smallest of a metric; only who works with the past can be it."""
    causal = [name for name, one in zip(names, is_causal, strict=True) if one]
    if not causal:
        return None

    def joined(all_of: Sequence[Replicates]) -> Replicates:
        parts = [one for one, chosen in zip(all_of, is_causal, strict=True) if chosen]
        return Replicates(*(np.stack([p[..., column] for p in same], axis=-1) for same in zip(*parts, strict=True)))

    found = joined(replicates)
    best, ratios, significant = best_of(found, confidence, lambda: joined(finer()))
    ratio = {name: entry(ratios, i) for i, name in enumerate(causal) if i != best}
    order = np.argsort(np.where(np.isnan(found.value), np.inf, found.value), kind="stable")
    runner_up = next((causal[i] for i in order if i != best), None)
    return {"name": causal[best], "significant": significant, "runner_up": runner_up, "ratio": ratio}


def _efficiency(one: xr.Dataset, rmse: Interval, epoch: int) -> dict[str, Any]:
    """Return bound, RMSE over bound, and whether that is an efficiency."""
    empty = np.full(one.sizes["time"], np.nan)
    bound, of_truth = (
        one[name].values[0] if name in one else empty for name in ("bound_position", "bound_truth_position")
    )
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = Interval(*(part / bound[epoch] for part in rmse))
    return {
        "bound_position_m": json_numbers(bound[epoch]),
        "efficiency": entry(ratio),
        # the two bounds differ by the process noise only
        "efficiency_means_something": bool(np.isfinite(bound[epoch]) and np.allclose(bound, of_truth, rtol=1e-6)),
    }


def nees_entry(
    values: Array, lost: NDArray[np.bool_], states: int, draws: PairedBootstrap, confidence: float
) -> dict[str, Any]:
    """Return the mean NEES per state, the band of a consistent filter, and where it lies.

    A trial that is lost has an infinite one: left out, those that survive would speak for all.
    """
    values = np.where(lost, np.inf, values)
    count = int(np.count_nonzero(~np.isnan(values)))
    per = states or math.nan  # none in common with the truth
    found = interval(draws.apply(values[:, None] / per, lambda means: means), confidence)
    lower, upper = (float(end) / per for end in chi_square_band(states * count, max(count, 1), confidence))
    mean = float(found.value[0])
    verdict = None
    if count and not math.isnan(mean):
        verdict = "low" if mean < lower else "high" if mean > upper else "in band"
    band = None if not (count and states) else {"low": lower, "high": upper}
    return {
        "states": states,
        "nees_per_state": entry(found, 0),
        "nees_band": band,
        "nees_verdict": verdict,
    }


def entry(found: Interval, index: int | tuple[()] = ()) -> dict[str, float | None]:
    """Return one value with its interval, as JSON has it."""
    return {name: json_numbers(np.asarray(part)[index]) for name, part in found._asdict().items()}


def machine() -> str:
    """Return what the costs were measured on."""
    name = platform.processor() or platform.machine()
    cpus = Path("/proc/cpuinfo")
    if cpus.is_file():
        lines = cpus.read_text(encoding="utf-8", errors="replace").splitlines()
        name = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), name)
    python = ".".join(map(str, sys.version_info[:3]))
    return f"{name}, Python {python}, drake {version('drake')}, numpy {np.__version__}"
