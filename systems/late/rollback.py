"""An estimator that goes back to when a late measurement was made, and from there on again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiscreteValues

from quietfix.systems.counting import tally
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.memory import Epoch, Given, Innovation, Memory, Now, Remembered
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.whitening import Whitener, unknown_rows
from quietfix.systems.late.arrived import Arrived, Clearing, FedStart

__all__ = ["Rollback", "goes_back"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SAME = 1e-9  # s
_OWN = ("_calc_prior", "_calc_posterior", "_predicted", "_begin", "_initialize", "_store", "_declare_ports")
_BEGINNINGS = {"_begin", "_declare_ports"}
_FRESH = ("rows", "sites", "inputs", "noise")  # nothing is known of them at a new instant


def goes_back(block: Estimator) -> bool:
    """Return whether an estimator is nothing but what it remembers, and `Rollback` can go back with it."""
    kind = type(block)
    own_way = [name for name in _OWN if getattr(kind, name) is not getattr(Estimator, name)]
    plain = not own_way or (block.begins_plainly and set(own_way) <= _BEGINNINGS)
    ports = {
        "measurement",
        "platforms",
        *block.start.inputs,
        *(["noise_covariance"] if block.wiring.noise_port else []),
    }
    own = {block.get_input_port(i).get_name() for i in range(block.num_input_ports())}
    return plain and own == ports


class Rollback(Estimator):
    r"""Any estimator, with measurements that carry their own time.

    It keeps what it knew and what was measured at the last ticks. When a measurement arrives, it stands at the tick
    that it was made at, and all from there on is done again, gates, openings and new beginnings too: the same as if it
    had been there in time (Bar-Shalom, *Update with out-of-sequence measurements in tracking: exact solution*, IEEE
    Trans. Aerospace and Electronic Systems 38 (2002) 769-778, which finds the same for linear systems without a
    buffer). One that was made before the buffer is left out, and counted on the port ``dropped``.

    .. math:: x_k = u(p(x_{k-1}, t_k - t_{k-1}), z_k), \qquad k = j, ..., n

    for the tick j at which the oldest row that has arrived was made, up to the latest one, n; p and u are the
    estimator's prediction and update.

    The ports are those of every estimator, and what it tells of its memory (`Estimator.tell`), of now: what is known at
    this instant with all that has arrived. The innovation is that of the latest instant of which a measurement has
    arrived. What comes with a measurement (the noise covariance, what the start is given) is that of its own tick.

    Inputs besides: ``arrivals`` (trials, ages rows) and ``measured_at`` (trials, ages), see
    `quietfix.systems.late.delay.Delay`.

    Parameters
    ----------
    block : Estimator
        Any that `goes_back`; it is used for its mathematics, and is in no diagram itself.
    ages : int
        How many instants can arrive at once.
    ticks : int
        How many instants are kept, >= 1; measurements of earlier ones are dropped.
    stream : sequence of str, optional
        Names of the rows that arrive; by default those that the estimator takes.
    clearings : sequence of Clearing
        What makes of them those that it takes, one after the other, by its own prediction for their time.

    Raises
    ------
    ValueError
        If the estimator has more than what it remembers.
    """

    def __init__(
        self,
        block: Estimator,
        ages: int,
        ticks: int,
        stream: Sequence[str] | None = None,
        clearings: Sequence[Clearing] = (),
    ) -> None:
        name = block.get_name()
        if not goes_back(block):
            raise ValueError(
                f"estimators.{name}: late measurements are not allowed; it has more than what it remembers from "
                "measurement to measurement, and cannot go back to the time of one"
            )
        if ticks < 1:
            raise ValueError(f"{name}: a buffer of {ticks} instants is not allowed; at least 1")
        self.inner, self._clearings = block, list(clearings)
        self._sizes = dict(block.memory_sizes())
        self._kept, self._ages = ticks + 1, ages  # the oldest one is where one begins again
        wiring = block.wiring if stream is None else replace(block.wiring, stream=list(stream))
        self._stream = len(wiring.stream)
        self._given_inputs = dict(block.start.inputs)
        self.causal, self.note = block.causal, block.note
        self.restarts_when_lost, self.considered = block.restarts_when_lost, block.considered
        ports = {"arrivals": ages * self._stream, "measured_at": ages}
        super().__init__(name, block.model, block.motion, FedStart(block.start, ports), wiring)
        for port, (size, of, components) in block.told.items():
            self.tell(port, size, partial(self._told_now, of), components)
        self.tell("dropped", 1, lambda memory: memory["dropped"])
        if "restarts" in block.tallies():
            self.count_restarts()

    @property
    def bound_model(self) -> Any:
        """See `Estimator.bound_model`."""
        return self.inner.bound_model

    def bound_prior(self, truth: Array, platforms: Array) -> tuple[Array | None, bool]:
        """See `Estimator.bound_prior`."""
        return self.inner.bound_prior(truth, platforms)

    def diagnostics(self) -> Sequence[str]:
        """See `Watching.diagnostics`."""
        return [port for port in self.inner.diagnostics() if port in self.told]

    def tallies(self) -> Sequence[str]:
        """See `Watching.tallies`."""
        return self.inner.tallies()

    def says_lost(self, memory: Memory) -> Mask | None:
        """See `Watching.says_lost`."""
        return self.inner.says_lost(self._now(memory))

    def _told_now(self, of: Any, memory: Memory) -> Array:
        told: Array = of(self._now(memory))
        return told

    # ---- memory: beliefs, what was measured and from where, of the last instants, the latest first

    def memory_sizes(self) -> Mapping[str, int]:
        """See `Estimator.memory_sizes`."""
        size, carriers = sum(self._sizes.values()), 6 * self.inner.wiring.platforms
        slots = {"belief": size, "begun": 1, "watches": 2, "rows": self._stream, "sites": carriers, "times": 1}
        if self._given_inputs:
            slots["inputs"] = sum(self._given_inputs.values())
        if self.inner.wiring.noise_port:
            slots["noise"] = len(self.inner.wiring.stream) ** 2
        self._slotted = list(slots)
        kept = {name: self._kept * width for name, width in slots.items()}
        return {**kept, "origin": size, "origin_time": 1, "dropped": 1}

    def _empty(self, time: float) -> Memory:
        trials = self.wiring.trials
        memory = {name: np.full((trials, size), np.nan) for name, size in self.memory_sizes().items()}
        memory["begun"][:], memory["watches"][:], memory["dropped"][:] = 0.0, 0.0, 0.0
        memory["times"][:, 0] = time
        return memory

    def _slots(self, memory: Memory, name: str) -> Array:
        values = memory[name]
        return values.reshape(values.shape[0], self._kept, -1)

    def _now(self, memory: Memory) -> Memory:
        return self._opened(self._slots(memory, "belief")[:, 0])

    def _opened(self, flat: Array) -> Memory:
        """Return the inner estimator's memory of one instant (trials, size)."""
        opened, begin = {}, 0
        for group, size in self._sizes.items():
            opened[group] = np.ascontiguousarray(flat[:, begin : begin + size])
            begin += size
        return opened

    def _closed(self, memory: Memory) -> Array:
        memory = self.inner.settled(memory)
        return np.concatenate([memory[group].reshape(self.wiring.trials, -1) for group in self._sizes], axis=-1)

    def begin(self, mean: Array, covariance: Array, epoch: Epoch) -> Memory:
        """See `Estimator.begin`."""
        able: Any = np.isfinite(mean).all(axis=-1)
        return self._with_origin(self.inner.begin(mean, covariance, epoch), able, epoch)

    def _with_origin(self, begun: Memory, able: Mask, epoch: Epoch) -> Memory:
        memory = self._empty(epoch.time)
        memory["origin"] = np.where(able[:, None], self._closed(begun), np.nan)
        memory["origin_time"] = np.where(able[:, None], epoch.time, np.nan)
        self._slots(memory, "belief")[:, 0] = memory["origin"]
        self._slots(memory, "begun")[:, 0, 0] = able
        return memory

    def moments(self, memory: Memory) -> tuple[Array, Array]:
        """See `Estimator.moments`: those of the latest instant."""
        return self.inner.moments(self._now(memory))

    def predict(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """See `Estimator.predict`: one more instant, of which nothing is measured yet."""
        moved = dict(memory)
        for name in self._slotted:
            slots = np.roll(self._slots(memory, name), 1, axis=1)
            slots[:, 0] = np.nan if name in _FRESH else slots[:, 1]
            moved[name] = slots.reshape(memory[name].shape)
        self._slots(moved, "times")[:, 0] = epoch.time
        self._slots(moved, "belief")[:, 0] = self._closed(self.inner.predict(self._now(memory), dt, epoch))
        return moved

    # ---- going back

    def update(self, memory: Memory, observation: Observation, epoch: Epoch) -> tuple[Memory, Innovation]:
        """See `Estimator.update`: everything again from the earliest instant of which something arrives."""
        assert isinstance(observation, Arrived)
        memory = {name: np.array(values) for name, values in memory.items()}
        trials = self.wiring.trials
        own = observation.platforms.reshape(observation.platforms.shape[0], -1)
        self._slots(memory, "sites")[:, 0] = np.broadcast_to(own, (trials, own.shape[-1]))
        if self._given_inputs:
            told = [observation.inputs[port].reshape(trials, -1) for port in self._given_inputs]
            self._slots(memory, "inputs")[:, 0] = np.concatenate(told, axis=-1)
        if observation.noise is not None:
            self._slots(memory, "noise")[:, 0] = observation.noise.reshape(observation.noise.shape[0], -1)
        fresh = self._placed(memory, observation)
        reported = self._nothing()
        for slot in range(int(np.flatnonzero(fresh.any(axis=0)).max(initial=0)), -1, -1):
            innovation = self._again(memory, slot, epoch)
            if innovation is not None:
                new = fresh[:, slot]
                reported = Innovation(
                    *(
                        np.where(new.reshape(-1, *[1] * (a.ndim - 1)), b, a)
                        for a, b in zip(reported, innovation, strict=True)
                    )
                )
        return memory, reported

    def _placed(self, memory: Memory, observation: Arrived) -> Mask:
        """Put what arrives at the instants that it was made at; return of which there is something new."""
        rows, times = self._slots(memory, "rows"), self._slots(memory, "times")[..., 0]
        fresh = np.zeros((self.wiring.trials, self._kept), dtype=bool)
        for age in range(self._ages):
            value, made = observation.value[:, age], observation.made[:, age]
            there = np.isfinite(value)
            same = np.abs(times[:, :-1] - made[:, None]) <= _SAME  # not the oldest: nothing is known of before it
            known = same.any(axis=-1)
            memory["dropped"][:, 0] += np.where(known, 0, np.count_nonzero(there, axis=-1))
            who = np.flatnonzero(known & there.any(axis=-1))
            at = same.argmax(axis=-1)[who]
            rows[who, at] = np.where(there[who], value[who], rows[who, at])
            fresh[who, at] = True
        return fresh

    def _again(self, memory: Memory, slot: int, epoch: Epoch) -> Innovation | None:
        """Do one instant again, from what is known of the one before it; return the innovation, if there is one."""
        beliefs, begun, watches, times = (self._slots(memory, name) for name in ("belief", "begun", "watches", "times"))
        present = np.isfinite(times[:, slot, 0])
        if not present.any():
            return None
        time = float(times[present, slot, 0][0])
        then = epoch if slot == 0 else Epoch(time, self.wiring.clock.index(time), epoch.draw)
        belief, started = self._opened(beliefs[:, slot + 1]), begun[:, slot + 1, 0] > 0
        earlier = times[:, slot + 1, 0]
        if np.isfinite(earlier).any():
            belief = self.inner.predict(belief, time - float(np.nanmax(earlier)), then)
        given = self._given_then(memory, slot, belief, then)
        stream = given.stream
        if not started.all():
            belief, started, stream = self._starting(memory, belief, started, given)
        measurement, whitener = self._rows_of(stream, memory, slot)
        told: Mask = np.isfinite(measurement).any(axis=-1) & started
        innovation, watch = None, np.ascontiguousarray(watches[:, slot + 1].T)
        if told.any():
            seen = Observation(np.where(told[:, None], measurement, np.nan), given.platforms, whitener)
            updated, innovation = self.inner.update(belief, seen, then)
            belief = self.inner.settled(belief)
            belief = {
                group: np.where(told[:, None], updated[group].reshape(value.shape), value)
                for group, value in belief.items()
            }
            watch = self.inner.followed(watch, belief, innovation, told)
            if self.inner.may_begin_again:
                belief = self.inner.begin_again(belief, watch, told, lambda: self.inner.first(*given))
            belief = self.inner.recovered(belief, innovation, lambda: given)
        beliefs[:, slot], begun[:, slot, 0], watches[:, slot] = self._closed(belief), started, watch.T
        return innovation

    def _given_then(self, memory: Memory, slot: int, belief: Memory, then: Epoch) -> Given:
        """Return what an estimator is given of one instant; phases are cleared by what it predicts for that."""
        platforms = self._slots(memory, "sites")[:, slot].reshape(self.wiring.trials, -1, 6)
        platforms = platforms[: self.wiring.platform_trials]
        inputs, begin = {}, 0
        for port, size in self._given_inputs.items():
            inputs[port] = self._slots(memory, "inputs")[:, slot, begin : begin + size]
            begin += size
        stream = self._slots(memory, "rows")[:, slot]
        if self._clearings:
            prediction = self.inner.moments(belief)[0]
            for clearing in self._clearings:
                stream, _ = clearing.cleared(stream, prediction, platforms)
        return Given(stream, platforms, inputs, then)

    def _rows_of(self, stream: Array, memory: Memory, slot: int) -> tuple[Array, Whitener]:
        """Return the rows that the estimator's model has, and their noise."""
        measurement = stream[:, self.inner._rows]
        if "noise" not in memory:
            return measurement, self._whitener
        width = len(self.inner.wiring.stream)
        noise = self._slots(memory, "noise")[:, slot].reshape(-1, width, width)
        noise = noise[:, self.inner._rows][:, :, self.inner._rows]
        return np.where(unknown_rows(noise), np.nan, measurement), Whitener(noise)

    def _starting(self, memory: Memory, belief: Memory, started: Mask, given: Given) -> tuple[Memory, Mask, Array]:
        """Start the trials that have not by then; return beliefs, which have, and what is left of the measurement."""
        stream, time = given.stream, given.epoch.time
        again: Mask = ~started & (np.abs(memory["origin_time"][:, 0] - time) <= _SAME)
        begun, able = self.inner.first(*given)
        if self.start.uses_measurement:
            new: Mask = ~started & able
        else:  # made once: what is on its ports may be something else later
            new = ~started & np.isnan(memory["origin_time"][:, 0]) & able
            kept = self._opened(memory["origin"])
            begun = {
                group: np.where(again[:, None], kept[group], begun[group].reshape(len(again), -1)) for group in kept
            }
            memory["origin"] = np.where(new[:, None], self._closed(begun), memory["origin"])
            new = new | again
        memory["origin_time"] = np.where(new[:, None], time, memory["origin_time"])
        belief = self.inner.settled(belief)
        belief = {
            group: np.where(new[:, None], begun[group].reshape(value.shape), value) for group, value in belief.items()
        }
        if self.start.uses_measurement:
            stream = np.where(new[:, None], np.nan, stream)
        return belief, started | new, stream

    # ---- in the diagram

    def _begin(self, context: Context, discrete: DiscreteValues) -> None:
        """See `Estimator._begin`: nothing has arrived yet."""
        epoch, memory = self._epoch(context), self._empty(context.get_time())
        if not self.start.uses_measurement:
            nothing = np.full((self.wiring.trials, len(self.inner.wiring.stream)), np.nan)
            given = self._given(context)._replace(stream=nothing, epoch=epoch)
            memory = self._with_origin(*self.inner.first(*given), epoch)
        begun = self._slots(memory, "begun")[:, 0, 0] > 0
        self._write(discrete, memory, self._nothing(), begun, context.get_time(), False)

    def _calc_posterior(self, context: Context) -> Remembered:
        """See `Estimator._calc_posterior`."""
        tally("posterior", self)
        epoch = Now(context.get_time(), self.wiring.clock, self.draw, context)
        prior: Remembered
        prior = self.cached(context, self._prior) if self._prior_is_read else self._predicted(context, epoch)
        if prior.current:
            return prior
        given, trials = self._given(context), self.wiring.trials
        value = given.inputs["arrivals"].reshape(trials, self._ages, self._stream)
        noise = self.read(context, "noise_covariance") if self.wiring.noise_port else None
        made = given.inputs["measured_at"]
        arrived = Arrived(value, given.platforms, self._whitener, made, noise, given.inputs)
        memory, innovation = self.update(prior.memory, arrived, epoch)
        watch = np.ascontiguousarray(self._slots(memory, "watches")[:, 0].T)
        return Remembered(memory, innovation, self._slots(memory, "begun")[:, 0, 0] > 0, True, epoch.time, watch)
