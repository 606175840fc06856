"""Rows of a table that came late: one that is older than another before it in the file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.late import Late
from quietfix.diagrams.own.fed.played import Played
from quietfix.diagrams.parts.latency import LateBelief
from quietfix.systems.clocks import Clock
from quietfix.systems.sensors.played_late import PlayedLate
from quietfix.systems.sensors.played_rows import TableTrack
from quietfix.systems.signals import EnsembleBlock

__all__ = ["LateTable", "late_table", "too_late"]


@dataclass(frozen=True)
class LateTable(Late):
    """A table whose lines are in the order in which they came.

    Attributes
    ----------
    tracks : sequence of TableTrack
    """

    tracks: Sequence[TableTrack] = ()

    def delay(self, bus: Bus, clock: Clock, end: float) -> EnsembleBlock:
        """See `Late.delay`."""
        return PlayedLate(self.tracks, np.inf if self.buffer is None else self.buffer)

    def kept(self, bus: Bus, clock: Clock, end: float) -> int:
        """See `Late.kept`: what comes later is not played."""
        return bus.shape("measured_at")[1]


def late_table(fed: Played, belief: LateBelief, stream: Sequence[str]) -> LateTable | None:
    """Return what of a table came late; None: nobody asks, and rows are in the order of their times.

    Parameters
    ----------
    fed : Played
    belief : LateBelief
        It asks where it says a buffer, or that estimators take rows as they come.
    stream : sequence of str
        All rows in their order.
    """
    if belief.buffer_s is None and belief.times == "made":
        return None
    return LateTable((), list(stream), belief.times == "made", belief.buffer_s, fed.tracks)


def too_late(fed: Played, belief: LateBelief) -> list[str]:
    """Return a note on rows that came later than the buffer reaches."""
    if belief.buffer_s is None:
        return []
    late = [np.asarray(track.arrival) - track.clock.ticks(np.inf)[:, None] for track in fed.tracks]
    count = sum(int((np.isfinite(one) & (one > belief.buffer_s + 1e-9)).sum()) for one in late)
    said = f"{count} rows came later than belief.late.buffer_s ({belief.buffer_s:g} s), and are left out."
    return [said] if count else []
