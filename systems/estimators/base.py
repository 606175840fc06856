"""The estimator block: one contract for every filter.

The state is the last posterior and the time it holds for. A cache entry ``prior`` predicts it for now, a cache entry
``posterior`` updates it with the measurement of now, the ports read the caches, and an event at every tick
stores (posterior, now, used). So the log at t_k shows the estimate with the measurement of t_k, regular and
irregular sampling are one code path, and ``prediction`` does not feed through and can be fed back.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiscreteValues

from quietfix.systems.clocks import at_ticks, same_instant
from quietfix.systems.counting import tally
from quietfix.systems.estimators.memory import TO_COME, Epoch, Given, Innovation, Layout, Memory, Now, Remembered, Whole
from quietfix.systems.estimators.shown import Shown
from quietfix.systems.estimators.watching import Watching
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.whitening import Whitener, unknown_rows
from quietfix.systems.linear_algebra import all_finite
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.signals import components_of
from quietfix.systems.smoothing.smoother import Smoother
from quietfix.systems.starts.start import Start

__all__ = ["Estimator"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Estimator(Watching):
    """Base of all estimator blocks.

    Inputs ``measurement``, ``platforms``, where R comes with the measurement ``noise_covariance``, and what the
    start asks for. Outputs ``estimate``, ``covariance``, ``prediction``, ``prediction_covariance``, ``innovation``,
    ``nis``, ``nis_dof``, ``lost``; where the motion has biases behind the target's state, ``biases`` and
    ``bias_sigmas``, and the others are of the target alone.

    A subclass says what it remembers per trial (`memory_sizes`), how that begins, is predicted, updated and
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
        self._whitener = Whitener(model.noise_covariance())
        self.motion = motion
        self.start = start
        self.wiring = wiring
        rows = [list(wiring.stream).index(row) for row in model.names]
        # a view instead of a copy where all rows are used as they come
        self._rows: NDArray[np.intp] | slice = (
            slice(None) if rows == list(range(len(wiring.stream))) else np.array(rows, dtype=np.intp)
        )
        self._declare_ports()

    @property
    def bound_model(self) -> MeasurementModel:
        """What the estimator makes of the measurements, for the bound: the model, unless it uses less than that."""
        return self.model

    # ---- what an estimator says of itself

    causal: bool = True
    """False where it uses measurements before they are made (as a paper may)."""

    smoother: Smoother | None = None
    """What looks back on its estimates when a run is over, if it does."""

    note: str = ""
    """What a reader of its results must know."""

    def bound_prior(self, truth: Array, platforms: Array) -> tuple[Array | None, bool]:
        """Return the prior of the estimator's bound, and whether the first epoch's measurement is spent on it.

        Parameters
        ----------
        truth : ndarray, shape (trials or 1, n)
            The target at the first epoch, in the estimator's states.
        platforms : ndarray, shape (trials or 1, p, 6)
            The platforms at that epoch.

        Returns
        -------
        covariance : ndarray, shape (trials or 1, n, n), or None
            None where it cannot be said.
        spent : bool
        """
        return self.start.covariance_at(truth, platforms), self.start.uses_measurement

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
    def predict(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """Return the memory `dt` seconds later."""

    @abstractmethod
    def update(self, memory: Memory, observation: Observation, epoch: Epoch) -> tuple[Memory, Innovation]:
        """Return the memory given an observation, and the innovation.

        A row whose value is NaN is left out in its trial, and its noise covariance may be NaN. A trial whose memory is
        NaN has not started, or is lost: it stays so.
        """

    @abstractmethod
    def moments(self, memory: Memory) -> tuple[Array, Array]:
        """Return mean (trials, n) and covariance (trials, n, n)."""

    # ---- ports, caches and events

    def _declare_ports(self) -> None:
        wiring, m = self.wiring, self.model.size
        trials = wiring.trials
        self.declare_input("measurement", trials, len(wiring.stream))
        self.declare_input("platforms", wiring.platform_trials, 6 * wiring.platforms)
        self._platforms = (wiring.platform_trials, wiring.platforms, 6)
        if wiring.noise_port:
            self.declare_input("noise_covariance", trials, len(wiring.stream) ** 2)
        for port, size in self.start.inputs.items():
            self.declare_input(port, trials, size)
        inputs = {self.input_port_ticket(self.get_input_port(i).get_index()) for i in range(self.num_input_ports())}
        draw = self.declare_draw()

        # One group of discrete state for all of it: an access costs as much as copying thousands of numbers.
        sizes = self.memory_sizes()
        self._places: dict[str, slice] = {}
        begin = 0
        for group, size in {**sizes, "value": m, "nis": 1, "nis_dof": 1, "started": 1, "watch": 2}.items():
            self._places[group] = slice(begin, begin + trials * size)
            begin += trials * size
        self._groups = [(group, self._places[group], (trials, size)) for group, size in sizes.items()]
        self._remembered = list(sizes)
        self._reported = (self._places["value"], self._places["nis"], self._places["nis_dof"])
        initial = np.full(begin + 3, np.nan)
        self._started, self._watched = self._places["started"], self._places["watch"]
        initial[self._started] = initial[self._watched] = 0.0
        initial[-2:] = 0.0  # holds for this time; its measurement is used. Before them: begun at this time
        self._state = self.DeclareDiscreteState(initial)
        self._everyone = np.ones(trials, dtype=bool)
        self._everyone.setflags(write=False)
        self._all_begun = self._everyone.astype(float).tobytes()
        self._layout = Layout(self._groups, self._reported, self._watched, self._everyone)
        self._steps_at_once: bool | None = None  # not known yet
        now = {self.xd_ticket(), self.time_ticket(), draw}
        self._prior = self.declare_cached("prior", type(self)._calc_prior, now)
        self._prior_is_read = False  # by a port: until then nothing but the posterior needs it, and that once
        self._posterior = self.declare_cached("posterior", type(self)._calc_posterior, {*now, *inputs})
        before, after = {self.cached_ticket(self._prior)}, {self.cached_ticket(self._posterior)}
        rows, shown = components_of(self.model), Shown(self.motion)
        shown.declare(self, trials, self._posterior_moment, after, ("estimate", "covariance"))
        shown.declare(self, trials, self._prior_moment, before, ("prediction", "prediction_covariance"))
        shown.declare_biases(self, trials, self.posterior_moments, after)
        self.declare_output("innovation", trials, m, lambda c: self._updated(c).innovation.value, after, rows)
        self.declare_output("nis", trials, 1, lambda c: self._updated(c).innovation.nis, after)
        self.declare_output("nis_dof", trials, 1, lambda c: self._updated(c).innovation.nis_dof, after)
        self.declare_watch(trials, self._updated, after)

        at_ticks(
            wiring.clock,
            lambda period, offset: self.DeclarePeriodicDiscreteUpdateEvent(period, offset, self._store),
            lambda: self.DeclarePerStepDiscreteUpdateEvent(self._store_at_tick),
        )
        self.DeclareInitializationDiscreteUpdateEvent(self._initialize)

    def _epoch(self, context: Context) -> Now:
        return Now(context.get_time(), self.wiring.clock, self.draw, context)

    def _updated(self, context: Context) -> Remembered:
        remembered: Remembered = self.get_cache_entry(self._posterior).EvalAbstract(context).get_value()
        return remembered

    def posterior_memory(self, context: Context) -> Memory:
        """See `Watching.posterior_memory`."""
        return self._updated(context).memory

    def posterior_moments(self, context: Context) -> tuple[Array, Array]:
        """Return mean and covariance with the measurement of now."""
        return self._updated(context).moments(self.moments)

    def _posterior_moment(self, context: Context, which: int) -> Array:
        return self._updated(context).moment(which, self.moments)

    @property
    def posterior_ticket(self) -> Any:
        """What a port depends on that is made from `posterior_memory` or `posterior_moments`."""
        return self.cached_ticket(self._posterior)

    def _prior_moment(self, context: Context, which: int) -> Array:
        self._prior_is_read = True
        remembered: Remembered = self.cached(context, self._prior)
        return remembered.moment(which, self.moments)

    def _calc_prior(self, context: Context) -> Remembered:
        """Return the memory predicted for now, or what is stored where the measurement of now is in it."""
        return self._predicted(context, self._epoch(context))

    def _predicted(self, context: Context, epoch: Now) -> Remembered:
        tally("prior", self)
        state = context.get_discrete_state(self._state).CopyToVector()
        memory = {group: state[place].reshape(shape) for group, place, shape in self._groups}
        began = state[self._started]
        # bytes are the fastest to compare, and mostly everyone has started
        started = self._everyone if began.tobytes() == self._all_begun else began > 0
        now, stamp = epoch.time, state.item(-2)
        watch = state[self._watched].reshape(2, -1)
        if same_instant(now, stamp):
            state[-2] = now
            return Remembered(memory, self._reported, started, bool(state[-1]), now, watch, state)
        if now > stamp:
            memory = self.predict(memory, now - stamp, epoch)
        return Remembered(memory, TO_COME, started, False, now, watch)

    def _first(self, context: Context, stream: Array) -> tuple[Memory, Mask]:
        return self.first(*self._given(context)._replace(stream=stream))

    def _read_platforms(self, context: Context) -> Array:
        return self.read(context, "platforms", self._platforms)

    def _read_noise(self, context: Context) -> Array:
        width = len(self.wiring.stream)
        noise = self.read(context, "noise_covariance").reshape(-1, width, width)
        return noise[:, self._rows][:, :, self._rows]

    def _nothing(self) -> Innovation:
        """Return the innovation of an instant without a measurement."""
        trials = self.wiring.trials
        return Innovation(np.full((trials, self.model.size), np.nan), np.full(trials, np.nan), np.zeros(trials))

    def _calc_posterior(self, context: Context) -> Remembered:
        """Return memory, innovation and which trials have started, after the measurement of now."""
        belief = self._measured(context)
        if belief.state is not None:
            return belief
        told = belief.innovation, lambda: self._given(context)
        return belief.having(self.recovered(self.settled(belief.memory), *told))

    def _given(self, context: Context) -> Given:
        told = self.read(context, "measurement"), self._read_platforms(context)
        return Given(*told, {port: self.read(context, port) for port in self.start.inputs}, self._epoch(context))

    def _measured(self, context: Context) -> Remembered:
        tally("posterior", self)
        if self._steps_at_once is None:
            self._steps_at_once = self.prepare_steps_at_once()
        if self._steps_at_once and not self._prior_is_read and (whole := self._stepped(context)) is not None:
            return whole
        epoch = self._epoch(context)
        prior: Remembered
        prior = self.cached(context, self._prior) if self._prior_is_read else self._predicted(context, epoch)
        if prior.current:
            return prior
        memory, started, now = prior.memory, prior.started, epoch.time
        stream = self.read(context, "measurement")
        measurement = stream[:, self._rows]
        if started is not self._everyone and not started.all():
            memory, new = self.begin_late(memory, started, lambda: self._first(context, stream))
            started = started | new
            if self.start.uses_measurement:
                measurement = np.where(new[:, None], np.nan, measurement)
            if not started.any():
                return Remembered(memory, self._nothing(), started, True, now, prior.watch)
        noise = self._read_noise(context) if self.wiring.noise_port else None
        if noise is not None and (unknown := unknown_rows(noise)).any():
            measurement = np.where(unknown, np.nan, measurement)
        told = None if all_finite(measurement) else ~np.isnan(measurement).all(axis=-1) & started
        if told is not None and not told.any():
            return Remembered(memory, self._nothing(), started, True, now, prior.watch)
        whitener = self._whitener if noise is None else Whitener(noise)
        observation = Observation(measurement, self._read_platforms(context), whitener)
        updated, innovation = self.update(memory, observation, epoch)
        if told is not None and not told.all():
            # Even an update by nothing rounds, and alone such a trial is not updated at all.
            updated = {
                group: np.where(told[:, None], value, memory[group]) if group in memory else value
                for group, value in updated.items()
            }
        watch = self.followed(prior.watch, updated, innovation, told)
        if self.may_begin_again:
            some = started if told is None else told
            updated = self.begin_again(updated, watch, some, lambda: self._first(context, stream))
        return Remembered(updated, innovation, started, True, now, watch)

    def _stepped(self, context: Context) -> Remembered | None:
        """Return what `_calc_posterior` does, made in one go where all is as it usually is; else None."""
        state = context.get_discrete_state(self._state).CopyToVector()
        now, stamp = context.get_time(), state.item(-2)
        if now <= stamp or same_instant(now, stamp):
            return None
        told = self.read_flat(context, "measurement"), self.read_flat(context, "platforms")
        if not self.step_at_once(state, now - stamp, now, *told):
            return None
        tally("prior", self)
        return Whole(state, self._layout, now)

    def prepare_steps_at_once(self) -> bool:
        """Return whether `step_at_once` is worth a try; asked once, before the first."""
        return False

    def step_at_once(self, state: Array, dt: float, now: float, stream: Array, platforms: Array) -> bool:
        """Make of the block's state, in place, that of `now`, `dt` seconds later, with what its ports carry.

        Return False, whatever has become of the state, where the way by `predict` and `update` is to be gone: where
        not all trials have started, or something is missing.
        """
        return False

    def _write(
        self,
        discrete: DiscreteValues,
        memory: Memory,
        innovation: Innovation,
        started: Mask,
        time: float,
        used: bool,
        watch: Array | None = None,
    ) -> None:
        state = discrete.get_mutable_value(self._state)
        if list(memory) == self._remembered:  # all of it, as it stands in the state
            values = [v if v.ndim == 1 else v.ravel() for v in (*memory.values(), *innovation, started)]
            np.concatenate(values, out=state[: self._watched.start])
        else:
            named = {**memory, **innovation._asdict(), "started": started}
            for group, value in named.items():
                state[self._places[group]] = value.ravel()
        if watch is not None:
            state[self._watched] = watch.ravel()
        state[-2:] = time, used

    def _initialize(self, context: Context, discrete: DiscreteValues) -> None:
        """Start; a context that has been running for a while, in a Simulator of its own now, goes on as it is."""
        state = discrete.get_mutable_value(self._state)
        if state[-3] < context.get_time():
            return
        state[-3] = context.get_time()
        self._begin(context, discrete)

    def _begin(self, context: Context, discrete: DiscreteValues) -> None:
        """Start at the first instant; a start made from a measurement has then used that measurement."""
        memory, started = self._first(context, self.read(context, "measurement"))
        self._write(discrete, memory, self._nothing(), started, context.get_time(), self.start.uses_measurement)

    def _store(self, context: Context, discrete: DiscreteValues) -> None:
        updated = self._updated(context)
        if updated.state is not None:
            discrete.set_value(self._state, updated.state)
            return
        told = updated.memory, updated.innovation, updated.started, updated.time
        self._write(discrete, *told, True, updated.watch)

    def _store_at_tick(self, context: Context, discrete: DiscreteValues) -> None:
        if self.wiring.clock.index(context.get_time()) is not None:
            self._store(context, discrete)
