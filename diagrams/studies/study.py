"""Monte Carlo studies: build a diagram once, run it chunk by chunk, return an xarray Dataset."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Diagram, DiagramBuilder

from quietfix.diagrams.assembly.build import Assembly, build
from quietfix.diagrams.assembly.find import Found, find
from quietfix.diagrams.assembly.model import Model
from quietfix.diagrams.assembly.recorded import Report
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.chunks.jobs import Tell
from quietfix.diagrams.chunks.part import Part, added
from quietfix.diagrams.chunks.plan import Plan, even
from quietfix.diagrams.console.progress import Progress
from quietfix.diagrams.schema.errors import UserError, choose, in_users_words
from quietfix.diagrams.schema.origins import origins_of
from quietfix.diagrams.smoothing.looking_back import look_back
from quietfix.diagrams.statistics.bounds import StudyBounds
from quietfix.diagrams.statistics.score import Score
from quietfix.diagrams.studies.dataset import BIAS_PORTS, Shape, states_of
from quietfix.diagrams.studies.described import described
from quietfix.diagrams.studies.request import (
    KEEP,
    Request,
    attributes_of,
    check_numbers,
    check_threads,
    count_of,
    estimators_of,
)
from quietfix.diagrams.studies.runs import Run, Running, effort, longest, padded, runs, simulate, size_of_chunk, thinned
from quietfix.diagrams.studies.starting import arrivals, counted, say_unmeasured
from quietfix.systems.integration import simulator_of
from quietfix.systems.kernels.sharing import threads as shared_among
from quietfix.systems.recorder import record

__all__ = ["Study"]

Array = NDArray[np.float64]

_WORTH = 1.1  # a diagram that was built is used again unless the run would cost more than this many times as much


class Study:
    """A study that is built and can be run; `run_study` is the short way.

    Parameters
    ----------
    system, variant, scenario, estimators, trials, first_trial, seed, set, keep, every, chunk, threads
        See `run_study`.
    model : Model, optional
        What the scenario declares, where that is known already.

    Attributes
    ----------
    model : Model
        What the scenario declares, once for all that the study builds.
    probe : Assembly
        Wired, and never simulated: it tells all that is to be known of the study before it runs.
    chunk : int
        Trials at once.
    """

    def __init__(
        self,
        system: str | System | Found,
        *,
        variant: str | None = None,
        scenario: Any = None,
        estimators: Sequence[str] | None = None,
        trials: int | None = None,
        first_trial: int = 0,
        seed: int = 0,
        set: Sequence[str] | Mapping[str, Any] | None = None,
        keep: str = "estimates",
        every: int = 1,
        chunk: int | None = None,
        threads: int = 1,
        model: Model | None = None,
    ) -> None:
        self.found = found = find(system, variant)
        self.system = found.system
        check_numbers(trials, first_trial, seed, every, chunk)
        choose("keep", keep, KEEP)
        scenario = self.system.resolve(found.variant, scenario, set)
        self._origins = origins_of(scenario)
        scenario = dataclasses.replace(scenario, estimators=dict(scenario.estimators))
        self._origins.remember(scenario)
        with self._origins.placing():
            chosen = estimators_of(found, scenario, estimators)
        scenario.estimators = {key: scenario.estimators[key] for key in chosen}
        self.model = model or found.model(scenario)
        self.recorded = self.model.recorded
        count = count_of(found, self.recorded, trials, int(first_trial))
        self.request = Request(
            found.reference,
            found.variant,
            scenario,
            chosen,
            count,
            int(first_trial),
            int(seed),
            keep,
            int(every),
            chunk,
            check_threads(threads, count),
        )
        # Two trials tell what each trial has of its own from what all share; in one both look alike.
        with self.blaming():
            self.probe = self.assemble(DiagramBuilder(), 1 if self.recorded else 2)
            shapes = self._signals(self.probe)[1]
            shared = {signal for signal, (alike, _) in shapes.items() if alike == 1 and not self.recorded}
            self._shape = Shape(self.probe, self._keeps, shared)
            self._floats = sum(size for _, size in shapes.values())
            self._truth_names = self.probe.truth_names
            self._epochs = longest(self.model, count, int(first_trial), int(every))
            self._asked_chunk = chunk
            self.chunk = self._width(self.request.trials)
        self._running: Running | None = None

    @property
    def trial_bytes(self) -> float:
        """How many bytes all that is kept of a trial takes, before it is compressed."""
        return 8 * self._floats * (len(self.model.clock.ticks(self.model.duration)) / self.request.every)

    def _width(self, count: int) -> int:
        """Return how many of so many trials to run at once, so that the memory of a chunk is bounded."""
        if self.recorded is not None:
            return 1
        if self._asked_chunk:
            return self._asked_chunk
        return even(count, self.trial_bytes, self.model.widest)

    # ---- building

    def wire(self, trials: int) -> tuple[Assembly, DiagramBuilder, dict[str, Score]]:
        """Return the wired diagram under construction for a batch of trials, and its scores."""
        builder = DiagramBuilder()
        wired = self.assemble(builder, trials)
        scores = {}
        for name, estimator in wired.estimators.items():
            names = self._truth_names, estimator.motion.reported.names
            score = builder.AddSystem(Score(f"score_{name}", trials, wired.bus.shape("truth")[0], *names))
            builder.Connect(wired.truth, score.GetInputPort("truth"))
            for port in ("estimate", "covariance"):
                builder.Connect(estimator.GetOutputPort(port), score.GetInputPort(port))
            scores[name] = score
        return wired, builder, scores

    def diagram(self, trials: int = 1) -> tuple[Diagram, Assembly]:
        """Return a diagram without scores and recorder, for a user to continue from."""
        wired = self.assemble(DiagramBuilder(), trials)
        with self.blaming():
            return wired.finish(self.system.name), wired

    @cached_property
    def picture(self) -> Diagram:
        """The diagram as it is drawn, without scores and recorder: that of the probe."""
        with self.blaming():
            return self.probe.finish(self.system.name)

    def assemble(self, builder: DiagramBuilder, trials: int, estimators: Sequence[str] | None = None) -> Assembly:
        """Put parts and estimators (by default those of the study) into a diagram under construction.

        Raises
        ------
        UserError
            If something does not fit.
        """
        options = self.request.scenario.estimators
        with self._origins.placing(), in_users_words(), self.blaming():
            chosen = {name: options[name] for name in estimators or self.request.estimators}
            wired = build(self.model, builder, chosen, trials)
            blocks = [block.get_name() for block in builder.GetSystems()]
            blocks += ["recorder", "course", *(f"score_{name}" for name in wired.estimators)]
            for name in {name for name in blocks if blocks.count(name) > 1}:
                what = "estimators" if name in wired.estimators else "block"
                raise UserError(f"{what}: the name {name} is not allowed; another block of the diagram has it")
        return wired

    def _signals(
        self, wired: Assembly, scores: Mapping[str, Score] | None = None
    ) -> tuple[dict[str, Any], dict[str, tuple[int, int]]]:
        """Return the ports to record by name, and their shapes."""
        ports = wired.course
        for name, estimator in wired.estimators.items():
            wanted = ["estimate", "nis", "nis_dof", "lost"]
            wanted += [port for port in BIAS_PORTS if estimator.HasOutputPort(port)]
            wanted += [port for port in ("covariance", "innovation", "prediction") if self._keeps(port)]
            ports |= {f"{name}/{port}": estimator.GetOutputPort(port) for port in wanted}
        if scores is not None:
            ports |= {f"{name}/nees": score.GetOutputPort("nees") for name, score in scores.items()}
        extra = {"measurement": wired.measurement, **wired.signals}
        ports |= {name: port for name, port in extra.items() if self._keeps(name)} | wired.tallies
        shapes = {name: port.get_system().output_size(port.get_name()) for name, port in ports.items()}
        return ports, shapes

    def _keeps(self, what: str) -> bool:
        """Return whether a port of the estimators, ``measurement``, or one of the model's signals is kept."""
        levels = {"covariance": ("covariance",), "innovation": (), "prediction": ()}
        asked = self.request.keep in ("all", *levels.get(what, ("measurements",)))
        return asked or (self.recorded is not None and what in self.recorded.keeps)

    # ---- running

    def chunks(self, progress: bool = False, first: int = 0, count: int | None = None) -> Iterator[xr.Dataset]:
        """Run the study and yield one Dataset per chunk.

        Parameters
        ----------
        progress : bool
            Show a progress bar.
        first, count : int
            Which of the study's trials are run, by default all; the study goes on with the diagram that it has.

        Yields
        ------
        xarray.Dataset
            A chunk of trials; the last one carries the bounds of those that were run.
        """
        trials = self.request.trials - first if count is None else count
        total: Array | None = None
        for part in self.parts(progress, first, trials):
            total, chunk, last = added((total, part.sums)), part.dataset, part.end == trials
            del part  # a generator keeps its variables while it waits and while the next chunk runs
            yield described(chunk.assign(self.bounds(total, chunk["time"].values))) if last else chunk
            del chunk

    def parts(
        self,
        progress: bool | Tell = False,
        first: int = 0,
        count: int | None = None,
        numbers: Collection[int] | None = None,
        width: int | None = None,
    ) -> Iterator[Part]:
        """Run the study and yield its chunks, which do not know of each other.

        Parameters
        ----------
        progress : bool or callable
            Show a progress bar, or what is told how many trials are done of those that are run.
        first, count
            As of `chunks`.
        numbers : collection of int, optional
            Which chunks are run, by default all.
        width : int, optional
            Trials of a chunk, whatever the study has run before; see `widths`.
        """
        trials = self.request.trials - first if count is None else count
        if numbers is not None and not numbers:
            return
        with self.blaming():
            running = self._diagram_for(trials, width)
        every = enumerate(runs(self.model, self.request.first_trial + first, trials, width or running.width))
        wanted = [(number, together) for number, together in every if numbers is None or number in numbers]
        total = sum(run.size for _, together in wanted for run in together)
        shown = progress is True
        with Progress(f"{self.system.name}, {trials} trials", total, shown, "trials") as bar:
            made = self._parts(running, wanted, progress if callable(progress) else bar.update)
            while True:
                with self.blaming():
                    part = next(made, None)
                if part is None:
                    return
                yield part
                del part

    def _parts(self, running: Running, wanted: Sequence[tuple[int, list[Run]]], tell: Tell) -> Iterator[Part]:
        wired, recorded, done = running.wired, self.recorded, 0
        simulator = simulator_of(running.diagram, step=self.model.step)
        bounds = self._bounds(wired)
        for number, together in wanted:
            begin, size = together[0].first, sum(run.size for run in together)
            times, signals, path = self._run(simulator, running, together, done, tell)
            present = np.isfinite(path["sensed"].swapaxes(0, 1)[:size])
            if bounds is not None:
                truth, platforms = path["truth"].swapaxes(0, 1)[:size], states_of(path["platforms"], size)
                with shared_among(self.request.threads):
                    bounds.add(truth, platforms, size, present, arrivals(path, size))
                del truth, platforms
            chunk = self._shape.dataset(times, signals, begin, size).assign_attrs(self.attributes())
            if recorded is not None and recorded.clocks:
                chunk = chunk.assign_coords(track=("trial", np.array(recorded.tracks)[begin : begin + size]))
            if number == 0:
                say_unmeasured(self.found, wired, present, arrivals(path, size))
            chunk = chunk.assign_coords(counted(wired, path, present, size))
            # a generator keeps its variables while it waits and while the next chunk runs
            del signals, path, present
            done += size
            yield Part(number, together[0].done, described(chunk), None if bounds is None else bounds.take())
            del chunk

    def _bounds(self, wired: Assembly) -> StudyBounds | None:
        """Return what sums the bounds of a diagram, if it has any."""
        if self.recorded is not None and not self.recorded.bounds:
            return None
        return StudyBounds(wired, wired.clock.ticks(wired.duration))

    def bounds(self, sums: Array | None, times: Array) -> dict[str, Any]:
        """Return the bounds of a study as variables, from the sums of its parts, at the epochs that are kept."""
        bounds = self._bounds(self.probe)
        if bounds is None or sums is None:
            return {}
        bounds.put(sums)
        kept = np.isin(bounds.times, times)
        return {name: (dims, values[:, kept]) for name, (dims, values) in bounds.variables().items()}

    def plan(self, **also: Any) -> Plan:
        """Return what is asked for, and `also` that: a run of the same plan can go on with what is finished."""
        trials = self.request.trials
        chunk = size_of_chunk(self.model, trials, min(self.chunk, trials))
        return Plan({**self.attributes(), **also}, trials, chunk)

    def _run(
        self, simulator: Simulator, running: Running, together: Sequence[Run], done: int, tell: Tell
    ) -> tuple[Array, dict[str, Array], dict[str, Array]]:
        """Return times, signals, and what the bounds read at all epochs, of the runs of a chunk."""
        logs = []
        for run in together:

            def told(share: float, before: int = done + run.done - together[0].done, run: Run = run) -> None:
                tell(before + run.size * share)

            with shared_among(self.request.threads):
                context = simulate(simulator, running.diagram, self.model, run, self.request.seed, told)
            found = [recorder.result(context) for recorder in running.recorders]
            logs.append(look_back(running.wired, found, run.clock))
            del context
        if together[0].clock is not None:
            times, signals = padded([log[0] for log in logs], together, self._epochs, self.request.every)
            return times, signals, signals
        (times, signals), path = logs[0][0], logs[0][-1][1]
        return times, signals, path

    def widths(self, counts: Sequence[int]) -> list[int]:
        """Return how wide the chunks are of so many trials, then of so many more: a diagram serves while it may."""
        found: list[int] = []
        for count in counts:
            width = min(self._width(count), count)
            if found and effort(count, found[-1]) <= _WORTH * effort(count, width):
                width = found[-1]
            found.append(width)
        return found

    def _diagram_for(self, count: int, width: int | None = None) -> Running:
        """Return the diagram that runs so many trials: the one that is there, unless another is much cheaper."""
        there, best = self._running, width or min(self._width(count), count)
        if (
            there is None
            or there.width < (width or 0)
            or effort(count, there.width, width) > _WORTH * effort(count, best)
        ):
            wired, builder, scores = self.wire(best)
            every = 1 if self._epochs else self.request.every
            clock = thinned(wired.clock, wired.duration, every)
            recorder = record(builder, self._signals(wired, scores)[0], clock)
            recorders = [recorder]
            if self.request.every > 1 and not self._epochs:
                # The bound's recursion needs every epoch, also those that are not kept.
                recorders.append(record(builder, wired.course, wired.clock, "course"))
            self._running = there = Running(best, wired, wired.finish(), recorders)
        return there

    @contextmanager
    def blaming(self) -> Iterator[None]:
        """Turn whatever a user's own code raises, in a class or in the system, into a `UserError` that names it."""
        with self._origins.placing(), self.found.blaming(self.request.scenario.estimators):
            yield

    @property
    def of_tracks(self) -> bool:
        """Whether the trials are tracks of unequal length; see `quietfix.diagrams.statistics.epochs`."""
        return self._epochs > 0

    def report(self, dataset: xr.Dataset) -> Report | None:
        """Return what a recording tells of a result beside its table; None: nothing, or epochs are left out."""
        if self.recorded is None or self.recorded.report is None or self.request.every > 1:
            return None
        return self.recorded.report(dataset)

    def attributes(self) -> dict[str, Any]:
        """Return what a result needs to be run again from itself."""
        return attributes_of(self.request, self.found, self.probe)
