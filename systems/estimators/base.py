"""The estimator block: one contract for every filter.

The state is the last posterior and the time it holds for. A cache entry ``prior`` moves it to now, a cache entry
``posterior`` updates it with the measurement of now, the ports read the caches, and an event at every tick
stores (posterior, now, used). So the log at t_k shows the estimate with the measurement of t_k, regular and
irregular sampling are one code path, and ``prediction`` does not feed through and can be fed back.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiscreteValues

from systems.clocks import Clock
from systems.estimators.start import Start
from systems.measurement.base import MeasurementModel
from systems.motion.base import MotionModel
from systems.signals import Draw, EnsembleBlock, check_trials

__all__ = ["Epoch", "Estimator", "Innovation", "Memory", "Wiring"]

Array = NDArray[np.float64]
Memory = dict[str, Array]


@dataclass(frozen=True)
class Wiring:
    """What surrounds an estimator; the same for all estimators of a diagram.

    Parameters
    ----------
    trials : int
        Trials of the ensemble.
    stream : sequence of str
        Names of the rows on the measurement port; an estimator picks those of its own model by name.
    clock : Clock
        When measurements come.
    platforms : int
        Number of carriers on the platforms port, six numbers each.
    platform_trials : int
        1 where all trials share the platforms, else `trials`.
    noise_port : bool
        True where R comes with the measurement, on the port ``noise_covariance``.
    """

    trials: int
    stream: Sequence[str]
    clock: Clock
    platforms: int
    platform_trials: int = 1
    noise_port: bool = False

    def __post_init__(self) -> None:
        """Check the arguments."""
        check_trials(self.trials)
        if self.platform_trials not in (1, self.trials):
            raise ValueError(f"platforms have {self.platform_trials} trials; 1 or {self.trials} are allowed")


class Epoch(NamedTuple):
    """Which instant it is: time [s], index of the tick (None between ticks), and the run's random numbers."""

    time: float
    tick: int | None
    draw: Draw


class Innovation(NamedTuple):
    """What an update reports: innovation (trials, m), NIS (trials,) and its degrees of freedom (trials,)."""

    value: Array
    nis: Array
    nis_dof: Array


class Estimator(EnsembleBlock):
    """Base of all estimator blocks.

    Inputs ``measurement``, ``platforms``, where R comes with the measurement ``noise_covariance``, and what the
    start asks for. Outputs ``estimate``, ``covariance``, ``prediction``, ``prediction_covariance``, ``innovation``,
    ``nis``, ``nis_dof``.

    A subclass says what it remembers per trial (`memory_sizes`), how that begins, moves, is corrected and
    summarised. It never reads a truth port.

    Parameters
    ----------
    name : str
        Name of the block.
    model : MeasurementModel
        The sensor as the estimator believes it to be.
    motion : MotionModel
        The motion as the estimator believes it to be.
    start : Start
        Makes the first belief.
    wiring : Wiring
        What surrounds the block.

    Raises
    ------
    ValueError
        If a row of the model is not on the measurement port.
    """

    def __init__(self, name: str, model: MeasurementModel, motion: MotionModel, start: Start, wiring: Wiring) -> None:
        super().__init__(name)
        absent = [row for row in model.names if row not in wiring.stream]
        if absent:
            raise ValueError(f"{name}: rows {absent} are not measured; there are {list(wiring.stream)}")
        self.model = model
        self.motion = motion
        self.start = start
        self.wiring = wiring
        self._rows = [list(wiring.stream).index(row) for row in model.names]
        if self._rows == list(range(len(wiring.stream))):
            self._rows = slice(None)  # a view instead of a copy
        self._declare_ports()

    # ---- what a subclass provides

    @abstractmethod
    def memory_sizes(self) -> Mapping[str, int]:
        """Return what is remembered between ticks: name and numbers per trial."""

    @abstractmethod
    def begin(self, mean: Array, covariance: Array, epoch: Epoch) -> Memory:
        """Return the memory for a belief N(mean, covariance); NaN where a trial cannot start."""

    def first(
        self, measurement: Array, platforms: Array, inputs: Mapping[str, Array], epoch: Epoch
    ) -> tuple[Memory, NDArray[np.bool_]]:
        """Return the memory of the first belief and which trials have one (trials,); arguments as in `Start.begin`.

        A subclass overrides this where one Gaussian per trial cannot say what the start knows.
        """
        mean, covariance = self.start.begin(measurement, platforms, inputs)
        return self.begin(mean, covariance, epoch), np.isfinite(mean).all(axis=-1)

    @abstractmethod
    def move(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """Return the memory `dt` seconds later."""

    @abstractmethod
    def correct(
        self,
        memory: Memory,
        measurement: Array,
        platforms: Array,
        noise_covariance: Array | None,
        epoch: Epoch,
    ) -> tuple[Memory, Innovation]:
        """Return the memory given a measurement, and the innovation."""

    @abstractmethod
    def moments(self, memory: Memory) -> tuple[Array, Array]:
        """Return mean (trials, n) and covariance (trials, n, n)."""

    # ---- ports, caches and events

    def _declare_ports(self) -> None:
        wiring, n, m = self.wiring, self.motion.size, self.model.size
        trials = wiring.trials
        self.declare_input("measurement", trials, len(wiring.stream))
        self.declare_input("platforms", wiring.platform_trials, 6 * wiring.platforms)
        if wiring.noise_port:
            self.declare_input("noise_covariance", trials, len(wiring.stream) ** 2)
        for port, size in self.start.inputs.items():
            self.declare_input(port, trials, size)
        inputs = {self.input_port_ticket(self.get_input_port(i).get_index()) for i in range(self.num_input_ports())}
        draw = self.declare_draw()

        self._groups: dict[str, tuple[Any, int]] = {}
        for group, size in {
            **self.memory_sizes(),
            "innovation": m,
            "nis": 1,
            "nis_dof": 1,
            "started": 1,
        }.items():
            fill = 0.0 if group == "started" else np.nan
            self._groups[group] = (self.DeclareDiscreteState(np.full(trials * size, fill)), size)
        self._stamp = self.DeclareDiscreteState([0.0, 0.0])  # holds for this time; its measurement is used

        state = self.xd_ticket()
        self._prior = self.declare_cached("prior", type(self)._calc_prior, {state, self.time_ticket(), draw})
        self._prior_moments = self.declare_cached(
            "prior_moments",
            lambda me, context: me.moments(me.cached(context, me._prior)),
            {self.cached_ticket(self._prior)},
        )
        self._posterior = self.declare_cached(
            "posterior", type(self)._calc_posterior, {self.cached_ticket(self._prior), state, draw, *inputs}
        )
        self._moments = self.declare_cached(
            "moments",
            lambda me, context: me.moments(me.cached(context, me._posterior)[0]),
            {self.cached_ticket(self._posterior)},
        )
        before = {self.cached_ticket(self._prior_moments)}
        after = {self.cached_ticket(self._moments)}
        update = {self.cached_ticket(self._posterior)}
        self.declare_output("estimate", trials, n, lambda c: self.cached(c, self._moments)[0], after)
        self.declare_output("covariance", trials, n * n, lambda c: self.cached(c, self._moments)[1], after)
        self.declare_output("prediction", trials, n, lambda c: self.cached(c, self._prior_moments)[0], before)
        self.declare_output(
            "prediction_covariance", trials, n * n, lambda c: self.cached(c, self._prior_moments)[1], before
        )
        for i, (port, size) in enumerate((("innovation", m), ("nis", 1), ("nis_dof", 1))):
            self.declare_output(port, trials, size, lambda c, i=i: self.cached(c, self._posterior)[1][i], update)

        wiring.clock.declare(
            lambda period, offset: self.DeclarePeriodicDiscreteUpdateEvent(period, offset, self._store)
        )
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)

    def _epoch(self, context: Context) -> Epoch:
        time = context.get_time()
        return Epoch(time, self.wiring.clock.index(time), self.draw(context))

    def _group(self, context: Context, group: str) -> Array:
        index, size = self._groups[group]
        return context.get_discrete_state(index).value().reshape(-1, size).copy()

    def _calc_prior(self, context: Context) -> Memory:
        memory = {group: self._group(context, group) for group in self.memory_sizes()}
        dt = context.get_time() - float(context.get_discrete_state(self._stamp).value()[0])
        return self.move(memory, dt, self._epoch(context)) if dt > 0 else memory

    def _inputs_of_start(self, context: Context) -> dict[str, Array]:
        return {port: self.read(context, port) for port in self.start.inputs}

    def _read_platforms(self, context: Context) -> Array:
        return self.read(context, "platforms").reshape(-1, self.wiring.platforms, 6)

    def _calc_posterior(self, context: Context) -> tuple[Memory, Innovation, Array]:
        """Return memory, innovation and which trials have started, after the measurement of now."""
        prior = self.cached(context, self._prior)
        started = self._group(context, "started")[:, 0] > 0
        time, used = context.get_discrete_state(self._stamp).value()
        if used and time == context.get_time():
            stored = (self._group(context, group) for group in ("innovation", "nis", "nis_dof"))
            value, nis, dof = stored
            return prior, Innovation(value, nis[:, 0], dof[:, 0]), started
        stream = self.read(context, "measurement")
        measurement = stream[:, self._rows]
        trials, m = measurement.shape
        if started.any() and not np.isnan(measurement).all():
            noise = None
            if self.wiring.noise_port:
                width = len(self.wiring.stream)
                noise = self.read(context, "noise_covariance").reshape(trials, width, width)
                noise = noise[:, self._rows][:, :, self._rows]
            platforms = self._read_platforms(context)
            memory, innovation = self.correct(prior, measurement, platforms, noise, self._epoch(context))
        else:
            memory = prior
            innovation = Innovation(np.full((trials, m), np.nan), np.full(trials, np.nan), np.zeros(trials))
        if not started.all():
            memory, innovation, started = self._begin_late(context, memory, innovation, started, stream)
        return memory, innovation, started

    def _begin_late(
        self,
        context: Context,
        memory: Memory,
        innovation: Innovation,
        started: NDArray[np.bool_],
        stream: Array,
    ) -> tuple[Memory, Innovation, NDArray[np.bool_]]:
        """Start the trials that could not start before, and leave the others alone."""
        begun, able = self.first(
            stream, self._read_platforms(context), self._inputs_of_start(context), self._epoch(context)
        )
        new = ~started & able
        if not new.any():
            return memory, innovation, started
        memory = {group: np.where(new[:, None], begun[group], memory[group]) for group in memory}
        fresh = Innovation(
            np.where(new[:, None], np.nan, innovation.value),
            np.where(new, np.nan, innovation.nis),
            np.where(new, 0.0, innovation.nis_dof),
        )
        return memory, fresh, started | new

    def _write(
        self,
        discrete: DiscreteValues,
        memory: Memory,
        innovation: Innovation,
        started: NDArray[np.bool_],
        time: float,
        used: bool,
    ) -> None:
        values = {
            **memory,
            "innovation": innovation.value,
            "nis": innovation.nis,
            "nis_dof": innovation.nis_dof,
            "started": started,
        }
        for group, value in values.items():
            discrete.set_value(self._groups[group][0], np.ravel(value).astype(float))
        discrete.set_value(self._stamp, [time, float(used)])

    def _initialize(self, context: Context, discrete: DiscreteValues) -> None:
        """Start at the first instant; a start made from a measurement has then used that measurement."""
        time = context.get_time()
        trials = self.wiring.trials
        memory, started = self.first(
            self.read(context, "measurement"),
            self._read_platforms(context),
            self._inputs_of_start(context),
            self._epoch(context),
        )
        nothing = Innovation(np.full((trials, self.model.size), np.nan), np.full(trials, np.nan), np.zeros(trials))
        self._write(discrete, memory, nothing, started, time, self.start.uses_measurement)

    def _store(self, context: Context, discrete: DiscreteValues) -> None:
        memory, innovation, started = self.cached(context, self._posterior)
        self._write(discrete, memory, innovation, started, context.get_time(), used=True)
