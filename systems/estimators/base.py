"""The estimator block: one contract for every filter.

The state is the last posterior and the time it holds for. A cache entry ``prior`` moves it to now, a cache entry
``posterior`` updates it with the measurement of now, the ports read the caches, and an event at every tick
stores (posterior, now, used). So the log at t_k shows the estimate with the measurement of t_k, regular and
irregular sampling are one code path, and ``prediction`` does not feed through and can be fed back.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiscreteValues

from systems.clocks import Clock, same_instant
from systems.estimators.start import Start
from systems.filters.whitening import unknown_rows
from systems.measurement.base import MeasurementModel
from systems.motion.base import MotionModel
from systems.signals import Draw, EnsembleBlock, check_trials

__all__ = ["Epoch", "Estimator", "Innovation", "Memory", "Wiring"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
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


class Epoch:
    """Which instant it is.

    Parameters
    ----------
    time : float
        [s].
    tick : int, callable or None
        Index of the tick, None between ticks; a callable is asked only when somebody wants to know.
    draw : Draw or callable
        The run's random numbers; likewise.
    """

    __slots__ = ("_draw", "_tick", "time")

    def __init__(
        self, time: float, tick: int | Callable[[], int | None] | None, draw: Draw | Callable[[], Draw]
    ) -> None:
        self.time = time
        self._tick = tick
        self._draw = draw

    @property
    def tick(self) -> int | None:
        """Index of the tick, None between ticks."""
        return self._tick() if callable(self._tick) else self._tick

    @property
    def draw(self) -> Draw:
        """The run's random numbers."""
        return self._draw() if callable(self._draw) else self._draw


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
        rows = [list(wiring.stream).index(row) for row in model.names]
        # a view instead of a copy where all rows are used as they come
        self._rows: list[int] | slice = slice(None) if rows == list(range(len(wiring.stream))) else rows
        self._declare_ports()

    @property
    def bound_model(self) -> MeasurementModel:
        """What the estimator makes of the measurements, for the bound: the model, unless it uses less than that."""
        return self.model

    # ---- what a subclass provides

    @abstractmethod
    def memory_sizes(self) -> Mapping[str, int]:
        """Return what is remembered between ticks: name and numbers per trial."""

    @abstractmethod
    def begin(self, mean: Array, covariance: Array, epoch: Epoch) -> Memory:
        """Return the memory for a belief N(mean, covariance); NaN where a trial cannot start."""

    def first(
        self, measurement: Array, platforms: Array, inputs: Mapping[str, Array], epoch: Epoch
    ) -> tuple[Memory, Mask]:
        """Return the memory of the first belief and which trials have one (trials,); arguments as in `Start.begin`.

        A subclass overrides this where one Gaussian per trial cannot say what the start knows.
        """
        mean, covariance = self.start.begin(measurement, platforms, inputs)
        return self.begin(mean, covariance, epoch), np.all(np.isfinite(mean), axis=-1)

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
        """Return the memory given a measurement, and the innovation.

        A row that is NaN is left out in its trial; `noise_covariance` (trials, m, m), where there is one, may be NaN
        in such a row. A trial whose memory is NaN has not started, or is lost: it stays so.
        """

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
        self.declare_output("innovation", trials, m, lambda c: self.cached(c, self._posterior)[1].value, update)
        self.declare_output("nis", trials, 1, lambda c: self.cached(c, self._posterior)[1].nis, update)
        self.declare_output("nis_dof", trials, 1, lambda c: self.cached(c, self._posterior)[1].nis_dof, update)

        wiring.clock.declare(
            lambda period, offset: self.DeclarePeriodicDiscreteUpdateEvent(period, offset, self._store)
        )
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)

    def _epoch(self, context: Context) -> Epoch:
        time = context.get_time()
        return Epoch(time, lambda: self.wiring.clock.index(time), lambda: self.draw(context))

    def _group(self, context: Context, group: str) -> Array:
        index, size = self._groups[group]
        return context.get_discrete_state(index).value().reshape(-1, size).copy()

    def _calc_prior(self, context: Context) -> Memory:
        memory = {group: self._group(context, group) for group in self.memory_sizes()}
        now, stamp = context.get_time(), float(context.get_discrete_state(self._stamp).value()[0])
        if now <= stamp or same_instant(now, stamp):
            return memory
        return self.move(memory, now - stamp, self._epoch(context))

    def _first(self, context: Context, stream: Array) -> tuple[Memory, Mask]:
        inputs = {port: self.read(context, port) for port in self.start.inputs}
        return self.first(stream, self._read_platforms(context), inputs, self._epoch(context))

    def _read_platforms(self, context: Context) -> Array:
        return self.read(context, "platforms").reshape(-1, self.wiring.platforms, 6)

    def _read_noise(self, context: Context) -> Array | None:
        if not self.wiring.noise_port:
            return None
        width = len(self.wiring.stream)
        noise = self.read(context, "noise_covariance").reshape(-1, width, width)
        return noise[:, self._rows][:, :, self._rows]

    def _nothing(self) -> Innovation:
        """Return the innovation of an instant without a measurement."""
        trials = self.wiring.trials
        return Innovation(np.full((trials, self.model.size), np.nan), np.full(trials, np.nan), np.zeros(trials))

    def _calc_posterior(self, context: Context) -> tuple[Memory, Innovation, Mask]:
        """Return memory, innovation and which trials have started, after the measurement of now."""
        memory: Memory = self.cached(context, self._prior)
        started = self._group(context, "started")[:, 0] > 0
        stamp, used = context.get_discrete_state(self._stamp).value()
        if used and same_instant(context.get_time(), stamp):
            value, nis, dof = (self._group(context, group) for group in ("innovation", "nis", "nis_dof"))
            return memory, Innovation(value, nis[:, 0], dof[:, 0]), started
        stream = self.read(context, "measurement")
        measurement = stream[:, self._rows]
        if not started.all():
            memory, new = self._begin_late(context, memory, started, stream)
            started = started | new
            if self.start.uses_measurement:
                measurement = np.where(new[:, None], np.nan, measurement)
        if not started.any() or np.isnan(measurement).all():
            return memory, self._nothing(), started
        noise = self._read_noise(context)
        if noise is not None and (unknown := unknown_rows(noise)).any():
            measurement = np.where(unknown, np.nan, measurement)
        platforms = self._read_platforms(context)
        memory, innovation = self.correct(memory, measurement, platforms, noise, self._epoch(context))
        return memory, innovation, started

    def _begin_late(self, context: Context, memory: Memory, started: Mask, stream: Array) -> tuple[Memory, Mask]:
        """Start the trials that could not start before, leave the others alone; return which have started now."""
        begun, able = self._first(context, stream)
        new = ~started & able
        if new.any():
            memory = {group: np.where(new[:, None], begun[group], memory[group]) for group in memory}
        return memory, new

    def _write(
        self,
        discrete: DiscreteValues,
        memory: Memory,
        innovation: Innovation,
        started: Mask,
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
            discrete.set_value(self._groups[group][0], np.ravel(value).astype(float, copy=False))
        discrete.set_value(self._stamp, [time, float(used)])

    def _initialize(self, context: Context, discrete: DiscreteValues) -> None:
        """Start at the first instant; a start made from a measurement has then used that measurement."""
        memory, started = self._first(context, self.read(context, "measurement"))
        self._write(discrete, memory, self._nothing(), started, context.get_time(), self.start.uses_measurement)

    def _store(self, context: Context, discrete: DiscreteValues) -> None:
        memory, innovation, started = self.cached(context, self._posterior)
        self._write(discrete, memory, innovation, started, context.get_time(), used=True)
