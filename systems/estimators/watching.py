"""How an estimator notices that it is lost, and how it begins again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.estimators.memory import Given, Innovation, Memory, Remembered, Told
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.recovery.surprise import ALARM, lasting, surprise
from quietfix.systems.linear_algebra import all_finite
from quietfix.systems.signals import EnsembleBlock
from quietfix.systems.starts.start import Start

__all__ = ["Watching"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class Watching(EnsembleBlock):
    """What every estimator has beside its belief: a flag, and where it may, another beginning.

    Output ``lost`` (trials, 1) is 1 where the innovations have been larger than they are said to be for long (see
    `quietfix.systems.filters.recovery.surprise`), or where a trial that had started has no finite estimate;
    ``restarts`` (trials, 1), of one that may begin again, says how often it has.

    Attributes
    ----------
    restarts_when_lost : bool
        Begin again, by the start, from the measurement of the epoch at which the flag is raised.
    considered : int
        How many biases stay in the innovations because they are only considered.
    begins_plainly : bool
        Whether it has the ports of every estimator, and begins as every one does, although its class may do otherwise.
    told : mapping of str to Told
        Its ports that are made of what is remembered; see `tell`.
    """

    restarts_when_lost: bool = False
    considered: int = 0
    begins_plainly: bool = False
    start: Start
    wiring: Wiring
    told: Mapping[str, Told] = MappingProxyType({})

    def moments(self, memory: Memory) -> tuple[Array, Array]:
        """See `quietfix.systems.estimators.base.Estimator.moments`."""
        raise NotImplementedError

    # ---- what a subclass may say

    def tallies(self) -> Sequence[str]:
        """Return output ports that count what has become of measurements and trials; they are always recorded."""
        return ("restarts",) if self._counts_restarts else ()

    def evidence(self, memory: Memory, innovation: Innovation) -> tuple[Array, Array]:
        """Return NIS and rows (trials,) by which is judged whether the estimator is lost: what it reports."""
        return innovation.nis, innovation.nis_dof

    def asks_to_begin_again(self, memory: Memory) -> Mask | None:
        """Return which trials (trials,) want to begin again for reasons of their own; None: none."""
        return None

    def says_lost(self, memory: Memory) -> Mask | None:
        """Return which trials (trials,) are lost for reasons of the estimator's own; None: none."""
        return None

    def diagnostics(self) -> Sequence[str]:
        """Return further output ports that are worth a log."""
        return ()

    def settled(self, memory: Memory) -> Memory:
        """Return the memory with all that prediction and update have put off."""
        return memory

    def recovered(self, memory: Memory, innovation: Innovation, given: Callable[[], Given]) -> Memory:
        """Return the memory after an update, in which trials have begun again by rules of the estimator's own."""
        return memory

    def keep_beginning(self, memory: Memory, begun: Memory) -> Memory:
        """Return what is remembered after beginning again, from what was and what the start gives: the latter."""
        return begun

    # ---- ports of what is remembered

    def posterior_memory(self, context: Context) -> Memory:
        """Return the memory with the measurement of now, for a subclass's own ports."""
        raise NotImplementedError

    @property
    def posterior_ticket(self) -> Any:
        """What a port depends on that is made from the memory with the measurement of now."""
        raise NotImplementedError

    def tell(
        self, port: str, size: int, of: Callable[[Memory], Array], components: Iterable[tuple[str, str]] | None = None
    ) -> None:
        """Declare an output (trials, size) that is made of what is remembered with the measurement of now.

        What goes back with an estimator has these ports too; others of a subclass it has not.
        """
        self.told = {**self.told, port: Told(size, of, components)}
        after = {self.posterior_ticket}
        self.declare_output(port, self.wiring.trials, size, lambda c: of(self.posterior_memory(c)), after, components)

    # ---- what is done with it

    @property
    def beginning(self) -> bool:
        """Whether the start can begin in the middle of a run: from a measurement, not from what was known before."""
        return self.start.uses_measurement

    @property
    def may_begin_again(self) -> bool:
        """Whether a trial can ever begin again."""
        return self.restarts_when_lost

    def restart_when_lost(self, wanted: bool, where: str) -> None:
        """Have lost trials begin again, or not.

        Raises
        ------
        ValueError
            If the start does not begin from a measurement.
        """
        if wanted and not self.beginning:
            raise ValueError(
                f"{where}: true is not allowed where the start is a prior, for that says where the target was at the "
                "first instant, not where it is when a trial is lost; false, or a start from measurements"
            )
        self.restarts_when_lost = wanted
        if wanted:
            self.count_restarts()

    def declare_watch(self, trials: int, updated: Callable[[Context], Remembered], after: set[Any]) -> None:
        """Declare the ports."""

        def lost(context: Context) -> Array:
            belief = updated(context)
            mean, _ = belief.moments(self.moments)
            gone = belief.watch[0] > ALARM
            if not all_finite(mean):
                gone |= ~np.isfinite(mean).all(axis=-1) & belief.started
            own = self.says_lost(belief.memory)
            flag: Array = (gone if own is None else gone | (own & belief.started)).astype(float)
            return flag

        self.declare_output("lost", trials, 1, lost, after, [("lost", "1")])
        self._watched_by = trials, updated, after
        self._counts_restarts = False

    def count_restarts(self) -> None:
        """Declare the port ``restarts``, if it is not there."""
        if not self._counts_restarts:
            trials, updated, after = self._watched_by
            self._counts_restarts = True
            self.declare_output("restarts", trials, 1, lambda c: updated(c).watch[1], after, [("restarts", "1")])

    def followed(self, watch: Array, memory: Memory, innovation: Innovation, told: Mask | None) -> Array:
        """Return the watch (2, trials) after an update; `told`: trials of which something was measured, None: all."""
        watch = watch.copy()
        nis, rows = self.evidence(memory, innovation)
        nis = nis / lasting(self.considered)
        rows = rows if told is None else np.where(told, rows, 0.0)
        surprise(np.ascontiguousarray(nis, float), np.ascontiguousarray(rows, float), watch[0])
        return watch

    @staticmethod
    def begin_late(memory: Memory, started: Mask, first: Callable[[], tuple[Memory, Mask]]) -> tuple[Memory, Mask]:
        """Start the trials that could not start before, leave the others alone; return which have started now."""
        begun, able = first()
        new = ~started & able
        return (_chosen(new, begun, memory) if new.any() else memory), new

    def begin_again(
        self, memory: Memory, watch: Array, started: Mask, first: Callable[[], tuple[Memory, Mask]]
    ) -> Memory:
        """Return the memory in which trials begin again that are to and can, and note that in the watch, in place."""
        wanted = np.zeros(started.shape, dtype=bool)
        if self.restarts_when_lost:
            wanted |= (watch[0] > ALARM) | ~np.isfinite(self.moments(memory)[0]).all(axis=-1)
        own = self.asks_to_begin_again(memory)
        wanted = (wanted if own is None else wanted | own) & started
        if not wanted.any():
            return memory
        begun, able = first()
        new = wanted & able
        begun = self.keep_beginning(memory, begun)
        watch[0, new] = 0.0
        watch[1, new] += 1.0
        return _chosen(new, begun, memory)


def _chosen(new: Mask, begun: Mapping[str, Array], memory: Memory) -> Memory:
    return {group: np.where(new[:, None], begun[group], memory[group]) for group in memory}
