"""An estimator that goes back to when a late measurement was made, and from there on again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiscreteValues

from quietfix.systems.counting import tally
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.memory import Epoch, Innovation, Memory, Now, Remembered
from quietfix.systems.filters.observation import Observation
from quietfix.systems.starts.start import Start

__all__ = ["Rollback", "goes_back"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SAME = 1e-9  # s
_OWN = (
    "_calc_prior",
    "_calc_posterior",
    "_predicted",
    "_begin",
    "begin_late",
    "followed",
    "_initialize",
    "_store",
    "_declare_ports",
)


@dataclass(frozen=True, slots=True)
class _Arrived(Observation):
    """What arrives at one instant: `value` is (trials, ages, rows of the stream), made at `made` (trials, ages) [s]."""

    made: Array
    inputs: Mapping[str, Array]


class _Fed(Start):
    """A start whose ports are also those of what arrives."""

    def __init__(self, start: Start, ports: Mapping[str, int]) -> None:
        self._start, self._ports = start, ports
        self.uses_measurement, self.count = start.uses_measurement, start.count

    @property
    def inputs(self) -> Mapping[str, int]:
        """See `Start`."""
        return {**self._start.inputs, **self._ports}

    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """See `Start.begin`."""
        return self._start.begin(measurement, platforms, inputs)

    def covariance_at(self, target: Array, platforms: Array) -> Array | None:
        """See `Start.covariance_at`."""
        return self._start.covariance_at(target, platforms)


def goes_back(block: Estimator) -> bool:
    """Return whether an estimator is nothing but what it remembers, and `Rollback` can go back with it."""
    kind = type(block)
    plain = all(getattr(kind, name) is getattr(Estimator, name) for name in _OWN)
    ports = {"measurement", "platforms", *block.start.inputs}
    own = {block.get_input_port(i).get_name() for i in range(block.num_input_ports())}
    return plain and own == ports and not block.may_begin_again


class Rollback(Estimator):
    r"""Any estimator, with measurements that carry their own time.

    It keeps what it knew and what was measured at the last ticks. When a measurement arrives, it stands at the tick
    that it was made at, and all from there on is done again: the same as if it had been there in time (Bar-Shalom,
    *Update with out-of-sequence measurements in tracking: exact solution*, IEEE Trans. Aerospace and Electronic Systems
    38 (2002) 769-778, which finds the same for linear systems without a buffer). One that was made before the buffer is
    left out, and counted on the port ``dropped``.

    .. math:: x_k = u(p(x_{k-1}, t_k - t_{k-1}), z_k), \qquad k = j, ..., n

    for the tick j at which the oldest row that has arrived was made, up to the latest one, n; p and u are the
    estimator's prediction and update.

    The ports are those of every estimator, and of now: what is known at this instant with all that has arrived. The
    innovation is that of the latest instant of which a measurement has arrived.

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

    Raises
    ------
    ValueError
        If the estimator has more than what it remembers.
    """

    def __init__(self, block: Estimator, ages: int, ticks: int) -> None:
        name = block.get_name()
        if not goes_back(block):
            raise ValueError(
                f"estimators.{name}: late measurements are not allowed; it cannot go back to their time, as "
                "one that may begin again cannot"
            )
        if ticks < 1:
            raise ValueError(f"{name}: a buffer of {ticks} instants is not allowed; at least 1")
        self.inner = block
        self._sizes = dict(block.memory_sizes())
        self._kept, self._ages = ticks + 1, ages  # the oldest one is where one begins again
        self._stream = len(block.wiring.stream)
        self.causal, self.note = block.causal, block.note
        ports = {"arrivals": ages * self._stream, "measured_at": ages}
        super().__init__(name, block.model, block.motion, _Fed(block.start, ports), block.wiring)
        dropped = {self.posterior_ticket}
        self.declare_output("dropped", self.wiring.trials, 1, lambda c: self.posterior_memory(c)["dropped"], dropped)

    @property
    def bound_model(self) -> Any:
        """See `Estimator.bound_model`."""
        return self.inner.bound_model

    def bound_prior(self, truth: Array, platforms: Array) -> tuple[Array | None, bool]:
        """See `Estimator.bound_prior`."""
        return self.inner.bound_prior(truth, platforms)

    # ---- memory: beliefs, what was measured and from where, of the last instants, the latest first

    def memory_sizes(self) -> Mapping[str, int]:
        """See `Estimator.memory_sizes`."""
        size = sum(self._sizes.values())
        slots = {"belief": size, "begun": 1, "rows": self._stream, "sites": 6 * self.inner.wiring.platforms, "times": 1}
        kept = {name: self._kept * width for name, width in slots.items()}
        return {**kept, "origin": size, "origin_time": 1, "dropped": 1}

    def _empty(self, time: float) -> Memory:
        trials = self.wiring.trials
        memory = {name: np.full((trials, size), np.nan) for name, size in self.memory_sizes().items()}
        memory["begun"][:], memory["dropped"][:] = 0.0, 0.0
        memory["times"][:, 0] = time
        return memory

    def _slots(self, memory: Memory, name: str) -> Array:
        values = memory[name]
        return values.reshape(values.shape[0], self._kept, -1)

    def _opened(self, flat: Array) -> Memory:
        """Return the inner estimator's memory of one instant (trials, size)."""
        opened, begin = {}, 0
        for group, size in self._sizes.items():
            opened[group] = np.ascontiguousarray(flat[:, begin : begin + size])
            begin += size
        return opened

    def _closed(self, memory: Memory) -> Array:
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
        return self.inner.moments(self._opened(self._slots(memory, "belief")[:, 0]))

    def predict(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """See `Estimator.predict`: one more instant, of which nothing is measured yet."""
        moved = dict(memory)
        for name in ("belief", "begun", "rows", "sites", "times"):
            slots = np.roll(self._slots(memory, name), 1, axis=1)
            slots[:, 0] = np.nan if name in ("rows", "sites") else slots[:, 1]
            moved[name] = slots.reshape(memory[name].shape)
        self._slots(moved, "times")[:, 0] = epoch.time
        before = self._opened(self._slots(memory, "belief")[:, 0])
        self._slots(moved, "belief")[:, 0] = self._closed(self.inner.predict(before, dt, epoch))
        return moved

    # ---- going back

    def update(self, memory: Memory, observation: Observation, epoch: Epoch) -> tuple[Memory, Innovation]:
        """See `Estimator.update`: everything again from the earliest instant of which something arrives."""
        assert isinstance(observation, _Arrived)
        memory = {name: np.array(values) for name, values in memory.items()}
        trials = self.wiring.trials
        own = observation.platforms.reshape(observation.platforms.shape[0], -1)
        self._slots(memory, "sites")[:, 0] = np.broadcast_to(own, (trials, own.shape[-1]))
        fresh = self._placed(memory, observation)
        reported = Innovation(np.full((trials, self.model.size), np.nan), np.full(trials, np.nan), np.zeros(trials))
        for slot in range(int(np.flatnonzero(fresh.any(axis=0)).max(initial=0)), -1, -1):
            innovation = self._again(memory, slot, observation, epoch)
            if innovation is not None:
                new = fresh[:, slot]
                reported = Innovation(
                    *(
                        np.where(new.reshape(-1, *[1] * (a.ndim - 1)), b, a)
                        for a, b in zip(reported, innovation, strict=True)
                    )
                )
        return memory, reported

    def _placed(self, memory: Memory, observation: _Arrived) -> Mask:
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

    def _again(self, memory: Memory, slot: int, observation: _Arrived, epoch: Epoch) -> Innovation | None:
        """Do one instant again, from what is known of the one before it; return the innovation, if there is one."""
        beliefs, begun, times = (self._slots(memory, name) for name in ("belief", "begun", "times"))
        present = np.isfinite(times[:, slot, 0])
        if not present.any():
            return None
        time = float(times[present, slot, 0][0])
        then = epoch if slot == 0 else Epoch(time, self.wiring.clock.index(time), epoch.draw)
        platforms = self._slots(memory, "sites")[:, slot].reshape(self.wiring.trials, -1, 6)
        platforms = platforms[: self.wiring.platform_trials]
        stream = self._slots(memory, "rows")[:, slot]
        before, started = beliefs[:, slot + 1], begun[:, slot + 1, 0] > 0
        earlier = times[:, slot + 1, 0]
        if np.isfinite(earlier).any():
            belief = self.inner.predict(self._opened(before), time - float(np.nanmax(earlier)), then)
        else:
            belief = self._opened(before)
        if not started.all():
            belief, started, stream = self._starting(memory, belief, started, stream, platforms, observation, then)
        measurement = stream[:, self._rows]
        told = np.isfinite(measurement).any(axis=-1) & started
        innovation = None
        if told.any():
            seen = Observation(np.where(told[:, None], measurement, np.nan), platforms, self._whitener)
            updated, innovation = self.inner.update(belief, seen, then)
            belief = {
                group: np.where(told[:, None], value.reshape(belief[group].shape), belief[group])
                for group, value in updated.items()
                if group in belief
            }
        beliefs[:, slot], begun[:, slot, 0] = self._closed(belief), started
        return innovation

    def _starting(
        self,
        memory: Memory,
        belief: Memory,
        started: Mask,
        stream: Array,
        platforms: Array,
        observation: _Arrived,
        then: Epoch,
    ) -> tuple[Memory, Mask, Array]:
        """Start the trials that have not by then; return beliefs, which have, and what is left of the measurement."""
        again = ~started & (np.abs(memory["origin_time"][:, 0] - then.time) <= _SAME)
        if self.start.uses_measurement:
            begun, able = self.inner.first(stream, platforms, observation.inputs, then)
            new = ~started & able
        else:  # made once: what is on its ports may be something else later
            fresh = ~started & np.isnan(memory["origin_time"][:, 0])
            begun, able = self.inner.first(stream, platforms, observation.inputs, then)
            new = fresh & able
            begun = {
                group: np.where(again[:, None], kept, begun[group])
                for group, kept in self._opened(memory["origin"]).items()
            }
            memory["origin"] = np.where(new[:, None], self._closed(begun), memory["origin"])
            new = new | again
        memory["origin_time"] = np.where(new[:, None], then.time, memory["origin_time"])
        belief = {group: np.where(new[:, None], begun[group], value) for group, value in belief.items()}
        if self.start.uses_measurement:
            stream = np.where(new[:, None], np.nan, stream)
        return belief, started | new, stream

    # ---- in the diagram

    def _begin(self, context: Context, discrete: DiscreteValues) -> None:
        """See `Estimator._begin`: nothing has arrived yet."""
        epoch, memory = self._epoch(context), self._empty(context.get_time())
        if not self.start.uses_measurement:
            inputs = {port: self.read(context, port) for port in self.start.inputs}
            nothing = np.full((self.wiring.trials, self._stream), np.nan)
            memory = self._with_origin(*self.inner.first(nothing, self._read_platforms(context), inputs, epoch), epoch)
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
        inputs = {port: self.read(context, port) for port in self.start.inputs}
        value = inputs["arrivals"].reshape(self.wiring.trials, self._ages, self._stream)
        platforms = self._read_platforms(context)
        arrived = _Arrived(value, platforms, self._whitener, inputs["measured_at"], inputs)
        memory, innovation = self.update(prior.memory, arrived, epoch)
        watch = self.followed(prior.watch, memory, innovation, None)
        return Remembered(memory, innovation, self._slots(memory, "begun")[:, 0, 0] > 0, True, epoch.time, watch)
