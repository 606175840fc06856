"""One number of a scenario is varied, the noise stays: what a mismatch costs, and whether the covariance tells."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.assembly.find import Found, find
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.chunks.jobs import Job, Runner, run_here
from quietfix.diagrams.chunks.part import added
from quietfix.diagrams.chunks.plan import Plan
from quietfix.diagrams.experiments.compared_study import ComparedStudy
from quietfix.diagrams.experiments.summary_entries import interval_entry, nearest_epoch, nees_entry, run_entry
from quietfix.diagrams.schema.errors import UserError, choose, texts
from quietfix.diagrams.schema.reading import fields_of, options_of
from quietfix.diagrams.statistics.bootstrap import PairedBootstrap, Replicates, interval, log_ratio
from quietfix.diagrams.statistics.json_numbers import json_numbers
from quietfix.diagrams.statistics.metrics import diverged, not_started
from quietfix.diagrams.statistics.state_errors import errors
from quietfix.diagrams.studies.described import described
from quietfix.diagrams.studies.recordings import only_simulated

__all__ = ["Sweep", "Vary", "parse_vary", "sweep", "sweep_statistics"]


Array = NDArray[np.float64]
Kept = Mapping[str, NDArray[Any]]

_FORM = "KEY=A:B:N, KEY=log:A:B:N or KEY=V1,V2,..., such as truth.sigma_tdoa_ns=log:5:80:5"


@dataclass(frozen=True)
class Vary:
    """What is varied.

    Attributes
    ----------
    key : str
        Dotted field of the scenario.
    values : tuple of float
        At least two.
    geometric : bool
        Whether the values are spaced by a factor.
    """

    key: str
    values: tuple[float, ...]
    geometric: bool = False


def parse_vary(text: str) -> Vary:
    """Read ``KEY=A:B:N``, ``KEY=log:A:B:N`` or ``KEY=V1,V2,...``.

    Raises
    ------
    UserError
        For anything else, fewer than two points, or a logarithm of what is not positive.
    """
    key, equals, spec = (part.strip() for part in text.partition("="))
    if not equals or not key or not spec:
        raise UserError(f"--vary: {text!r} is not allowed; {_FORM}")
    geometric = spec.startswith("log:")
    parts = spec.removeprefix("log:").split(":")
    try:
        if len(parts) == 1 and not geometric:
            values = tuple(float(value) for value in spec.split(","))
        else:
            begin, end, count = float(parts[0]), float(parts[1]), int(parts[2])
            if len(parts) != 3 or not (math.isfinite(begin) and math.isfinite(end)):
                raise ValueError
            if geometric and not (begin > 0 and end > 0):
                raise UserError(f"--vary: {text} is not allowed; logarithmic spacing needs numbers > 0")
            spaced = np.geomspace if geometric else np.linspace
            # the shortest number that is near enough: 0.3, not 0.30000000000000004
            values = tuple(float(f"{value:.12g}") for value in spaced(begin, end, max(count, 0)))
    except UserError:
        raise
    except (ValueError, IndexError):
        raise UserError(f"--vary: {text!r} is not allowed; {_FORM}") from None
    if len(set(values)) < 2:
        points = "1 point" if len(set(values)) == 1 else "no point"
        raise UserError(f"--vary: {text} has {points}; a sweep needs at least 2 different ones")
    return Vary(key, values, geometric)


def _numeric_kind(scenario: Any, key: str) -> type:
    """Return int or float, the type of a scenario's field.

    Raises
    ------
    UserError
        If there is no such field, or it is not a number.
    """
    holder, kinds, done = scenario, [], ""
    for part in key.split("."):
        if dataclasses.is_dataclass(holder):
            found = fields_of(type(holder))
            one = found[choose(f"--vary: {done}{part}", part, found)]
            kinds, holder = list(options_of(one.type)), getattr(holder, one.name)
        elif isinstance(holder, Mapping):
            holder = holder[choose(f"--vary: {done}{part}", part, holder)]
            kinds = [type(holder)]
        elif isinstance(holder, list):
            if not part.isdigit() or int(part) >= len(holder):
                raise UserError(f"--vary: {done}{part} is not known; {done[:-1]} has {len(holder)} entries, from 0")
            holder = holder[int(part)]
            kinds = [type(holder)]
        else:
            raise UserError(f"--vary: {done}{part} is not known; {done[:-1]} has no fields")
        done += part + "."
    numbers = [kind for kind in kinds if kind in (int, float)]
    if not numbers:
        raise UserError(f"--vary: {key} is not allowed; a field that is a number")
    return numbers[0]


class Sweep:
    """A sweep that is checked at every point and can be run.

    Parameters
    ----------
    system, variant, scenario, estimators, trials, seed, set, chunk, threads
        As of `quietfix.diagrams.run_study`; at least 2 trials.
    vary : str or Vary
        See `parse_vary`.
    at : float, optional
        When errors are taken [s]; by default at the end.

    Raises
    ------
    UserError
        For whatever cannot be run, at any point.
    """

    def __init__(
        self,
        system: str | System | Found,
        vary: str | Vary,
        *,
        variant: str | None = None,
        scenario: Path | str | None = None,
        estimators: Sequence[str] | None = None,
        trials: int = 100,
        seed: int = 0,
        set: Sequence[str] | None = None,
        at: float | None = None,
        chunk: int | None = None,
        threads: int = 1,
    ) -> None:
        self.vary = parse_vary(vary) if isinstance(vary, str) else vary
        if isinstance(trials, int) and trials == 1:
            raise UserError("trials: 1 is not allowed; intervals over trials need at least 2")
        found = find(system, variant)
        settings = texts("set", set)
        base = found.system.load(found.variant, scenario, settings)
        only_simulated(found, "sweep", base)
        kind = _numeric_kind(base, self.vary.key)
        if kind is int and any(value != int(value) for value in self.vary.values):
            raise UserError(f"--vary: {self.vary.key} = {self.vary.values} is not allowed; whole numbers")
        options: dict[str, Any] = {"estimators": estimators, "trials": trials, "seed": seed, "threads": threads}
        options["chunk"] = chunk
        self._studies, self._at = [], at
        for value in self.vary.values:
            point = found.system.resolve(found.variant, scenario, [*settings, f"{self.vary.key}={kind(value)!r}"])
            model = found.model(point)
            ticks = model.clock.ticks(model.duration)
            epoch = nearest_epoch(ticks, at)
            # only that epoch is kept, beside the first
            every = epoch if epoch > 0 else len(ticks)
            study = ComparedStudy(found, scenario=point, every=every, model=model, **options)
            self._studies.append((study, epoch, ticks))
        self.attributes = self._studies[0][0].attributes() | {
            "key": self.vary.key,
            "geometric": int(self.vary.geometric),
        }
        self._plans = [study.plan(command="sweep") for study, _, _ in self._studies]

    @cached_property
    def plan(self) -> Plan:
        """What is asked for; its chunks are those of the first point, then those of the second, and so on."""
        first = self._plans[0]
        asked = {"command": "sweep", "key": self.vary.key, "values": list(self.vary.values), "at": self._at}
        asked |= {"geometric": int(self.vary.geometric), "chunk": first.chunk, **first.asked}
        return Plan(asked, sum(plan.chunks for plan in self._plans), 1)

    @property
    def times(self) -> list[float]:
        """When errors are taken [s], by point."""
        return [float(ticks[epoch]) for _, epoch, ticks in self._studies]

    def numbers(self, point: int) -> range:
        """Return which chunks are those of a point."""
        before = sum(plan.chunks for plan in self._plans[:point])
        return range(before, before + self._plans[point].chunks)

    def run(self, runner: Runner, left: Collection[int]) -> Iterator[tuple[int, Array | None, Kept]]:
        """Run chunks.

        Parameters
        ----------
        runner : callable
            Who runs them.
        left : collection of int
            Which.

        Yields
        ------
        number : int
            Of a chunk, in any order.
        sums : ndarray
            Its part of the sums over all trials.
        kept : mapping of str to ndarray
            What `point` takes of it.
        """
        jobs = []
        for point, (study, _, _) in enumerate(self._studies):
            numbers = self.numbers(point)
            jobs.append(Job(study, self._plans[point], [n - numbers.start for n in numbers if n in left]))
        for point, part in runner(jobs):
            yield self.numbers(point).start + part.number, part.sums, self._reduced(point, part.dataset)
            del part

    def _reduced(self, point: int, chunk: xr.Dataset) -> Kept:
        """Return what a point takes of a chunk, by estimator and trial."""
        _, epoch, ticks = self._studies[point]
        index = int(np.argmin(np.abs(chunk["time"].values - ticks[epoch])))
        kept, never = chunk.isel(time=[index]), not_started(chunk)
        return {
            "position_error": errors(kept)["position"].values[:, :, 0],
            "nees": kept["nees"].transpose("estimator", "trial", "time").values[:, :, 0],
            "diverged": (diverged(chunk) & ~never).values,
            "not_started": never.values,
            "trial": chunk["trial"].values,
            "time": chunk["time"].values,
        }

    def point(self, point: int, kept: Sequence[Kept], sums: Iterable[Array | None]) -> xr.Dataset:
        """Return a point as a Dataset with the dimension ``point``, from all its chunks in their order."""
        study, epoch, ticks = self._studies[point]
        times = kept[0]["time"]
        index = int(np.argmin(np.abs(times - ticks[epoch])))
        found = study.bounds(added(sums), times)
        empty = np.full(len(study.states), np.nan)
        bounds = [found[n][1][:, index] if n in found else empty for n in ("bound_position", "bound_truth_position")]
        dims = ("point", "estimator", "trial")
        names = ("position_error", "nees", "diverged", "not_started")
        dataset = xr.Dataset(
            {
                **{name: (dims, np.concatenate([chunk[name] for chunk in kept], axis=1)[None]) for name in names},
                "bound_position": (dims[:2], bounds[0][None]),
                "bound_truth_position": (dims[:2], bounds[1][None]),
                "states": (dims[:2], np.array([list(study.states.values())])),
                "at": (("point",), [float(ticks[epoch])]),
            },
            {
                "point": [self.vary.values[point]],
                "estimator": list(study.states),
                "trial": np.concatenate([chunk["trial"] for chunk in kept]),
            },
            self.attributes,
        )
        return described(dataset)

    def points(self, runner: Runner = run_here) -> Iterator[xr.Dataset]:
        """Run the points one after the other and yield each as a Dataset with the dimension ``point``."""
        entries: dict[int, tuple[Array | None, Kept]] = {}
        turn = 0
        for number, sums, kept in self.run(runner, range(self.plan.chunks)):
            entries[number] = sums, kept
            while turn < len(self._studies) and all(n in entries for n in self.numbers(turn)):
                own = [entries.pop(n) for n in self.numbers(turn)]
                yield self.point(turn, [kept for _, kept in own], [sums for sums, _ in own])
                turn += 1


def sweep(system: str | System | Found, vary: str, **options: Any) -> dict[str, Any]:
    """Vary one number of a scenario and return the curves; arguments as of `Sweep`.

    Returns
    -------
    dict
        What ``sweep.json`` holds, see `sweep_statistics`.
    """
    return sweep_statistics(xr.concat(list(Sweep(system, vary, **options).points()), "point", combine_attrs="override"))


def sweep_statistics(dataset: xr.Dataset, confidence: float = 0.95, resamples: int = 9999) -> dict[str, Any]:
    """Return the curves of a sweep with pointwise intervals, bootstrapped over the trials.

    Parameters
    ----------
    dataset : xarray.Dataset
        The points of `Sweep.points`, joined.
    confidence : float
        Of every interval.
    resamples : int
        Of the bootstrap.

    Returns
    -------
    dict
        ``key``, ``values``, and by estimator lists over the values: ``rmse_position_m``, ``rmse_ratio`` (to the first
        value; paired, for the noise is the same), ``efficiency`` (RMSE over bound), ``nees_per_state``, ``nees_band``,
        ``nees_verdict``, ``diverged``, ``not_started``, ``bound_position_m``.
    """
    draws = PairedBootstrap(dataset.sizes["trial"], resamples)
    never = dataset["not_started"].transpose("trial", "estimator", "point").values
    error = dataset["position_error"].transpose("trial", "estimator", "point").values
    squares = np.square(np.where(never, np.nan, error))
    # the ratio is paired: over trials that start at every point
    paired = np.where(never.any(axis=-1, keepdims=True), np.nan, squares)
    curves: dict[str, Any] = {}
    for i, name in enumerate(dataset["estimator"].values):
        found = draws.apply(squares[:, i], np.sqrt)
        rmse = interval(found, confidence)
        same = draws.apply(paired[:, i], np.sqrt) if never[:, i].any() else found
        first = Replicates(*(part[..., :1] for part in same))
        ratio = interval(log_ratio(same, first), confidence)
        one = dataset.isel(estimator=i)
        bound, of_truth = one["bound_position"].values, one["bound_truth_position"].values
        points = range(dataset.sizes["point"])
        row: dict[str, Any] = {
            "rmse_position_m": [interval_entry(rmse, k) for k in points],
            "rmse_ratio": [interval_entry(type(ratio)(*(np.exp(part) for part in ratio)), k) for k in points],
            "bound_position_m": json_numbers(bound),
            "efficiency": [interval_entry(type(rmse)(*(part / bound for part in rmse)), k) for k in points],
            "efficiency_means_something": [
                bool(np.isclose(a, b, rtol=1e-6)) for a, b in zip(bound, of_truth, strict=True)
            ],
            "diverged": [int(n) for n in one["diverged"].sum("trial").values],
            "not_started": [int(n) for n in one["not_started"].sum("trial").values],
        }
        lost = np.isinf(squares[:, i])
        nees = [
            nees_entry(one["nees"].values[k], lost[:, k], int(one["states"].values[k]), draws, confidence)
            for k in points
        ]
        row |= {key: [each[key] for each in nees] for key in nees[0]}
        curves[str(name)] = row
    return {
        **run_entry(dataset),
        "key": dataset.attrs["key"],
        "values": [float(value) for value in dataset["point"].values],
        "time_s": [float(value) for value in dataset["at"].values],
        "confidence": confidence,
        "resamples": resamples,
        "estimators": curves,
    }
