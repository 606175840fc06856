"""Recorded I/Q samples of several receivers, compared pair by pair."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.parts.iq_comparison import PAIR_SIGNALS, pieces
from quietfix.systems.ambiguity.differences import Window
from quietfix.systems.ambiguity.estimate import CrossAmbiguity
from quietfix.systems.clocks import Clock, Periodic, Times
from quietfix.systems.iq.block import IqBlock
from quietfix.systems.signal_chain.cross_ambiguity import CrossAmbiguitySensor
from quietfix.systems.signal_chain.recorded_iq import RecordedIq
from quietfix.systems.signals import Component

__all__ = ["IqPairs"]


@dataclass(frozen=True)
class _Plan:
    """When windows are compared: a clock, the last of its ticks [s], and how many pieces are too short for one."""

    clock: Clock
    end: float
    short: int


@dataclass(frozen=True, eq=False)
class IqPairs:
    """A block for each recording and one for each pair; publishes the `PAIR_SIGNALS` of `iq_comparison`.

    Attributes
    ----------
    recordings : mapping of str to sequence of IqBlock
        By the receiver's name; of one sample rate, in one time, beginning at 0 or later. Several parts where a
        recording has gaps: what is compared lies in one part of each.
    pairs : sequence of (int, int)
        Main and auxiliary receiver, by their places in `recordings`.
    function : CrossAmbiguity
        How they are compared.
    window : Window
        Where the peak is sought.
    length : float
        Integration time [s].
    every : float
        Time from one comparison to the next [s].

    Raises
    ------
    ValueError
        If the recordings have not even one integration time in common.
    """

    recordings: Mapping[str, Sequence[IqBlock]]
    pairs: Sequence[tuple[int, int]]
    function: CrossAmbiguity
    window: Window
    length: float
    every: float

    def __post_init__(self) -> None:
        """Check that there is something to compare."""
        assert self.plan

    @property
    def signals(self) -> list[str]:
        """Names of the signals of all pairs."""
        return [f"{port}_{j}{i}" for i, j in self.pairs for port in PAIR_SIGNALS]

    @staticmethod
    def rows(pair: tuple[int, int]) -> list[Component]:
        """Return what is measured of a pair."""
        i, j = pair
        return [Component(f"tdoa_{j}{i}", "s"), Component(f"fdoa_{j}{i}", "Hz")]

    @property
    def _rate(self) -> float:
        return float(next(iter(self.recordings.values()))[0].sample_rate)

    @property
    def samples(self) -> int:
        """Samples that are integrated."""
        return round(self.length * self._rate)

    @property
    def _margin(self) -> int:
        """How many samples more the auxiliary receivers need on either side."""
        reach = np.max(np.abs(self.window.delay) + np.asarray(self.window.half_delay))
        return int(np.ceil(reach * self._rate)) + 8

    @cached_property
    def plan(self) -> _Plan:
        """When windows are compared: at the middle of each."""
        length, every = self.length, self.every
        common = pieces(list(self.recordings.values()))
        # as much before the first as the auxiliary receivers need, but a short piece is not lost for that
        spare = [min(self._margin / self._rate, max(0.0, 0.5 * (piece.duration - length))) for piece in common]
        counts = [
            int(np.floor((piece.duration - length - 2 * less) / every + 1e-9)) + 1 if piece.duration >= length else 0
            for piece, less in zip(common, spare, strict=True)
        ]
        if self.samples < 64 or not any(counts):
            longest = max((piece.duration for piece in common), default=0.0)
            raise ValueError(
                f"recordings: {longest:.4g} s in common are not allowed; at least the {length:.4g} s that "
                "are integrated, and 64 samples"
            )
        used = [
            (Periodic(every, piece.begin + less + 0.5 * length), count)
            for piece, less, count in zip(common, spare, counts, strict=True)
            if count
        ]
        ends = [one.offset + (count - 1) * every for one, count in used]
        clock: Clock = used[0][0]
        if len(used) > 1:
            ticks = [one.ticks(end)[:count] for (one, count), end in zip(used, ends, strict=True)]
            clock = Times(np.concatenate(ticks))
        return _Plan(clock, ends[-1], counts.count(0))

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        if bus.trials != 1:
            raise ValueError(f"trials: {bus.trials} at once are not allowed; a recording plays 1")
        names, clock = list(self.recordings), self.plan.clock
        for i, j in self.pairs:
            heard = {
                port: self._played(bus, names[which], extra)
                for port, which, extra in (("main", i, 0), ("auxiliary", j, self._margin))
            }
            sensor = CrossAmbiguitySensor(self.function, self.window, clock, 1, name=f"caf {names[j]} - {names[i]}")
            bus.add(sensor, gives={f"{port}_{j}{i}": port for port in PAIR_SIGNALS}, takes=heard)

    def clearest(self, poor: float) -> int:
        """Return the receiver with which the others are best compared.

        That is the first one, unless the variances of its pairs (the median over the others, in the middle of the
        recordings) are more than `poor` times as large as those of the best.
        """
        names = list(self.recordings)
        ticks = self.plan.clock.ticks(self.plan.end)
        clock = Times(ticks[ticks.size // 2 : ticks.size // 2 + 1])
        heard = [RecordedIq(self.recordings[name], clock, self.samples, self._margin) for name in names]
        variance = np.full((len(names), len(names)), np.nan)
        for i, j in self.pairs:
            main, auxiliary = (heard[k].block_at(float(clock.ticks(np.inf)[0])) for k in (i, j))
            found = replace(self.function, samples=self.samples)(main, auxiliary, self.window)
            variance[i, j] = variance[j, i] = found.variance[0, 0] if found.good[0] else np.inf
        typical = np.nanmedian(variance, axis=1)
        best = int(np.argmin(typical))
        return best if typical[0] > poor * typical[best] else 0

    def _played(self, bus: Bus, name: str, margin: int) -> str:
        """Return the signal of a recording with so many samples more on either side; it is played once."""
        block = name + (" with margin" if margin else "")
        if f"{block}.iq" not in bus:
            bus.add(RecordedIq(self.recordings[name], self.plan.clock, self.samples, margin, block))
        return f"{block}.iq"
