"""A way between sensor and estimators that takes time: measurements come late, and not in their order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, DiscreteValues

from quietfix.systems.clocks import Clock, at_ticks
from quietfix.systems.noise import uniform
from quietfix.systems.signals import EnsembleBlock

__all__ = ["Delay", "Latency"]

Array = NDArray[np.float64]

_ROUNDING = 1e-9  # of a second, by which an arrival may miss the tick that it is meant for


class Latency(NamedTuple):
    """How late the measurements of one sensor come.

    Attributes
    ----------
    rows : sequence of int
        Its rows; they come together.
    mean : float
        [s], >= 0.
    jitter : float
        Uniform within so much of the mean, drawn anew for each measurement [s], 0 to `mean`.
    """

    rows: Sequence[int]
    mean: float
    jitter: float = 0.0

    @property
    def most(self) -> float:
        """How late one can be [s]."""
        return self.mean + self.jitter


class Delay(EnsembleBlock):
    r"""Hold measurements back until they arrive; NaN before the first of them does.

    Input ``measurement`` (trials, m): what is measured at the ticks. Outputs, all NaN off the ticks:

    - ``arrivals`` (trials, ages m) and ``measured_at`` (trials, ages): what arrives at this tick, by how many ticks ago
      it was made, the youngest first, and the time that it was made [s].
    - ``measurement`` (trials, m): of each row the youngest that arrives; what one gets who does not know of the delay.
    - ``arrival`` (trials, m): when what is measured at this tick will arrive [s]; infinite: not before the end.

    Whatever arrives between two ticks is there at the second.

    What is measured at :math:`t_k` is there at the first tick at or after :math:`t_k + \delta_k`.

    Parameters
    ----------
    latencies : sequence of Latency
        Rows that are in none are not late.
    size : int
        Number of rows.
    clock : Clock
        When there are measurements.
    end : float
        End of the run [s].
    trials : int
    name : str
        Name of the block; part of the key of its noise.

    Raises
    ------
    ValueError
        For latencies that are none.
    """

    def __init__(
        self,
        latencies: Sequence[Latency],
        size: int,
        clock: Clock,
        end: float,
        trials: int,
        name: str = "delay",
    ) -> None:
        super().__init__(name)
        for one in latencies:
            if not (math.isfinite(one.mean) and math.isfinite(one.jitter) and 0 <= one.jitter <= one.mean):
                raise ValueError(
                    f"{name}: latency {one.mean} s with jitter {one.jitter} s is not allowed; 0 to the mean"
                )
        self._latencies, self._rows, self._trials, self._clock = list(latencies), size, trials, clock
        self._ticks = clock.ticks(end)
        self.ages = ages(self._ticks, max((one.most for one in latencies), default=0.0))
        self.declare_input("measurement", trials, size)
        draw = self.declare_draw()
        self._held = (self.ages - 1, trials, size)
        self._state = self.DeclareDiscreteState(np.full(2 * math.prod(self._held), np.nan))  # values, when they are due
        self._now_due = self.declare_cached("due", Delay._calc_due, {self.time_ticket(), draw})
        tickets = {self.input_ticket("measurement"), self.xd_ticket(), self.time_ticket(), draw}
        arrived = self.declare_cached("arrived", Delay._calc, tickets)
        after = {self.cached_ticket(arrived)}
        for port, width in {"arrivals": self.ages * size, "measured_at": self.ages, "measurement": size}.items():
            self.declare_output(port, trials, width, partial(self._what, arrived, port), after)
        self.declare_output("arrival", trials, size, self._arrival, {self.time_ticket(), draw})
        at_ticks(
            clock,
            lambda period, offset: self.DeclarePeriodicDiscreteUpdateEvent(period, offset, self._store),
            lambda: self.DeclarePerStepDiscreteUpdateEvent(self._store_at_tick),
        )

    def _what(self, arrived: Any, port: str, context: Context) -> Array:
        value: Array = self.cached(context, arrived)[port]
        return value

    def _due(self, context: Context, tick: int) -> Array:
        """Return at which tick what is measured at `tick` arrives, (trials, m); one beyond the last: never."""
        due = np.full((self._trials, self._rows), float(tick))
        for i, one in enumerate(self._latencies):
            late = np.full((self._trials, 1), one.mean)
            if one.jitter:
                draw = self.draw(context)
                name = f"{self.noise_name()}:{i}"
                drawn = uniform(draw.seed, name, draw.first_trial, self._trials, tick, 1)
                late = late + one.jitter * (2 * drawn - 1)
            due[:, list(one.rows)] = np.searchsorted(self._ticks, self._ticks[tick] + late - _ROUNDING)
        return due

    def _tick(self, context: Context) -> int | None:
        tick = self._clock.index(context.get_time())
        return tick if tick is not None and tick < len(self._ticks) else None

    def _calc_due(self, context: Context) -> Array | None:
        tick = self._tick(context)
        return None if tick is None else self._due(context, tick)

    def _read_held(self, context: Context) -> Array:
        held: Array = context.get_discrete_state(self._state).CopyToVector().reshape(2, *self._held)
        return held

    def _calc(self, context: Context) -> dict[str, Array]:
        tick, trials, rows = self._tick(context), self._trials, self._rows
        arrivals = np.full((trials, self.ages, rows), np.nan)
        made = np.full((trials, self.ages), np.nan)
        if tick is not None:
            held = self._read_held(context)
            now = self.read(context, "measurement"), self.cached(context, self._now_due)
            for age in range(min(self.ages, tick + 1)):
                value, due = held[:, age - 1] if age else now
                arrivals[:, age] = np.where(due == tick, value, np.nan)
                made[:, age] = np.where(np.isfinite(arrivals[:, age]).any(axis=-1), self._ticks[tick - age], np.nan)
        youngest = np.full((trials, rows), np.nan)
        for age in range(self.ages - 1, -1, -1):
            youngest = np.where(np.isfinite(arrivals[:, age]), arrivals[:, age], youngest)
        return {"arrivals": arrivals, "measured_at": made, "measurement": youngest}

    def _arrival(self, context: Context) -> Array:
        due = self.cached(context, self._now_due)
        if due is None:
            return np.full((self._trials, self._rows), np.nan)
        return np.append(self._ticks, np.inf)[due.astype(int)]

    def _store(self, context: Context, discrete: DiscreteValues) -> None:
        due = self.cached(context, self._now_due)
        if self.ages > 1 and due is not None:
            now = np.stack([self.read(context, "measurement"), due])[:, None]
            kept = np.concatenate([now, self._read_held(context)[:, :-1]], axis=1)
            discrete.get_mutable_vector(self._state).SetFromVector(kept.ravel())

    def _store_at_tick(self, context: Context, discrete: DiscreteValues) -> None:
        if self._clock.index(context.get_time()) is not None:
            self._store(context, discrete)


def ages(ticks: Array, most: float) -> int:
    """Return how many ticks old a measurement can be when it is there, and one more, where none is later than `most`.

    Parameters
    ----------
    ticks : ndarray, shape (ticks,)
        [s].
    most : float
        [s].
    """
    due = np.minimum(np.searchsorted(ticks, ticks + most - _ROUNDING), len(ticks) - 1)
    return int((due - np.arange(len(ticks))).max(initial=0)) + 1
