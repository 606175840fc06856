"""What an estimator remembers, at which instant, and what an update reports."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.clocks import Clock
from quietfix.systems.signals import Draw

__all__ = ["TO_COME", "Epoch", "Given", "Innovation", "Layout", "Memory", "Now", "Remembered", "Told", "Whole"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Memory = dict[str, Array]


class Epoch:
    """Which instant it is.

    Parameters
    ----------
    time : float
        [s].
    tick : int or None
        Index of the tick, None between ticks.
    draw : Draw
        The run's random numbers.
    """

    __slots__ = ("_draw", "_tick", "time")

    def __init__(self, time: float, tick: int | None, draw: Draw) -> None:
        self.time = time
        self._tick = tick
        self._draw = draw

    @property
    def tick(self) -> int | None:
        """Index of the tick, None between ticks."""
        return self._tick

    @property
    def draw(self) -> Draw:
        """The run's random numbers."""
        return self._draw


class Now(Epoch):
    """The instant of a context, which is asked only for what somebody wants to know; not to be kept.

    Parameters
    ----------
    time : float
        [s].
    clock : Clock
        Whose tick it is.
    draw_of : callable
        Returns the random numbers of a context.
    context : Context
    """

    __slots__ = ("_clock", "_context", "_draw_of")

    def __init__(self, time: float, clock: Clock, draw_of: Callable[[Context], Draw], context: Context) -> None:
        self.time = time
        self._clock = clock
        self._draw_of = draw_of
        self._context = context

    @property
    def tick(self) -> int | None:
        """See `Epoch.tick`."""
        return self._clock.index(self.time)

    @property
    def draw(self) -> Draw:
        """See `Epoch.draw`."""
        return self._draw_of(self._context)


class Given(NamedTuple):
    """What a start is given: the measurement (trials, rows), platforms (1 or trials, p, 6), ports, the instant."""

    stream: Array
    platforms: Array
    inputs: Mapping[str, Array]
    epoch: Epoch


class Told(NamedTuple):
    """An output that is made of the memory: its size, how, and name and unit of each component."""

    size: int
    of: Callable[[Memory], Array]
    components: Iterable[tuple[str, str]] | None


class Innovation(NamedTuple):
    """What an update reports: innovation (trials, m), NIS (trials,) and its degrees of freedom (trials,)."""

    value: Array
    nis: Array
    nis_dof: Array


TO_COME = Innovation(np.empty(0), np.empty(0), np.empty(0))  # of a prior


class Remembered:
    """What a cache holds: memory, innovation, which trials have started; the moments when they are first asked for.

    ``current`` says that the measurement of now, ``time`` [s], is in it. ``state`` is all of that as the block's
    discrete state, where it was made as a whole; the innovation is then taken from it when it is asked for.
    ``watch`` (2, trials) is the sum of `quietfix.systems.filters.recovery.surprise` and how often a trial began again.
    """

    __slots__ = ("_innovation", "_moments", "current", "memory", "started", "state", "time", "watch")

    def __init__(
        self,
        memory: Memory,
        innovation: Innovation | tuple[slice, slice, slice],
        started: Mask,
        current: bool,
        time: float,
        watch: Array,
        state: Array | None = None,
    ) -> None:
        self.memory = memory
        self._innovation = innovation
        self.started = started
        self.current = current
        self.time = time
        self.watch = watch
        self.state = state
        self._moments: tuple[Array, Array] | None = None

    @property
    def innovation(self) -> Innovation:
        """What the update reported."""
        if isinstance(self._innovation, Innovation):
            return self._innovation
        assert self.state is not None
        value, nis, rows = (self.state[place] for place in self._innovation)
        self._innovation = Innovation(value.reshape(nis.size, -1), nis, rows)
        return self._innovation

    def having(self, memory: Memory) -> Remembered:
        """Return the same with another memory."""
        if memory is self.memory:
            return self
        return Remembered(memory, self._innovation, self.started, self.current, self.time, self.watch, self.state)

    def moments(self, summarise: Callable[[Memory], tuple[Array, Array]]) -> tuple[Array, Array]:
        """Return mean and covariance."""
        if self._moments is None:
            self._moments = summarise(self.memory)
        return self._moments

    def moment(self, which: int, summarise: Callable[[Memory], tuple[Array, Array]]) -> Array:
        """Return the mean, 0, or the covariance, 1, in whatever shape."""
        return self.moments(summarise)[which]


class Layout(NamedTuple):
    """What stands where in an estimator's discrete state.

    Attributes
    ----------
    groups : list of (str, slice, (int, int))
        Of the memory: name, place, trials and numbers of each; mean and covariance are the first.
    reported : (slice, slice, slice)
        The innovation, NIS and rows used.
    watched : slice
        See `Remembered`.
    everyone : ndarray, shape (trials,)
        All have started.
    """

    groups: list[tuple[str, slice, tuple[int, int]]]
    reported: tuple[slice, slice, slice]
    watched: slice
    everyone: Mask


class Whole(Remembered):
    """What was made as a whole, as the block's next discrete state: taken apart when it is asked for."""

    __slots__ = ("_apart", "_layout")

    def __init__(self, state: Array, layout: Layout, time: float) -> None:
        self.state = state
        self._layout = layout
        self._innovation = layout.reported
        self.started = layout.everyone
        self.current = True
        self.time = time
        self._moments = None
        self._apart: Memory | None = None

    def __deepcopy__(self, memo: object) -> Whole:
        """Return a copy, for a clone of a context."""
        assert self.state is not None
        return Whole(self.state.copy(), self._layout, self.time)

    def moment(self, which: int, summarise: Callable[[Memory], tuple[Array, Array]]) -> Array:
        """See `Remembered.moment`."""
        assert self.state is not None
        return self.state[self._layout.groups[which][1]]

    @property
    def memory(self) -> Memory:  # type: ignore[override]
        """See `Remembered`."""
        if self._apart is None:
            assert self.state is not None
            self._apart = {group: self.state[place].reshape(shape) for group, place, shape in self._layout.groups}
        return self._apart

    @property
    def watch(self) -> Array:  # type: ignore[override]
        """See `Remembered`."""
        assert self.state is not None
        return self.state[self._layout.watched].reshape(2, -1)
