"""Rows of a table as they came: some of them later than others that were made after them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.playback.tracks import Tracked
from quietfix.systems.sensors.played_rows import TableTrack

__all__ = ["PlayedLate"]

Array = NDArray[np.float64]

_SAME = 1e-9  # s


class PlayedLate(Tracked):
    """What arrives at each tick of a track; the ports of `quietfix.systems.late.delay.Delay`, for one trial.

    Outputs ``arrivals`` (1, ages rows), ``measured_at`` (1, ages), ``measurement`` (1, rows), the youngest that arrives
    of each row, and ``arrival`` (1, rows), when what was made now comes [s]; infinite: later than `buffer`, or never.

    Parameters
    ----------
    tracks : sequence of TableTrack
        Of one target each, with `TableTrack.arrival`.
    buffer : float
        What comes later than this is left out [s].
    name : str
        Name of the block.
    """

    def __init__(self, tracks: Sequence[TableTrack], buffer: float, name: str = "delay") -> None:
        super().__init__(name, [track.clock for track in tracks])
        self._tables = [(track.clock.ticks(np.inf), track.value, _due(track, buffer)) for track in tracks]
        late = [int((due - np.arange(len(due))[:, None])[due >= 0].max(initial=0)) for _, _, due in self._tables]
        self.ages, rows = max(late) + 1, tracks[0].value.shape[1]
        for port, size in {"arrivals": self.ages * rows, "measured_at": self.ages, "measurement": rows}.items():
            self.declare_output(port, 1, size, partial(self._told, port), self.track_tickets)
        self.declare_output("arrival", 1, rows, self._arrival, self.track_tickets)

    def _told(self, port: str, context: Context) -> Array:
        track, tick = self.playing(context)
        times, value, due = self._tables[track]
        arrivals, made = np.full((self.ages, value.shape[1]), np.nan), np.full(self.ages, np.nan)
        for age in range(0 if tick is None else min(self.ages, tick + 1)):
            assert tick is not None
            arrivals[age] = np.where(due[tick - age] == tick, value[tick - age], np.nan)
            made[age] = times[tick - age] if np.isfinite(arrivals[age]).any() else np.nan
        if port == "measured_at":
            return made[None]
        if port == "arrivals":
            return arrivals.reshape(1, -1)
        youngest = arrivals[-1]
        for older in arrivals[-2::-1]:
            youngest = np.where(np.isfinite(older), older, youngest)
        return youngest[None]

    def _arrival(self, context: Context) -> Array:
        track, tick = self.playing(context)
        times, value, due = self._tables[track]
        if tick is None:
            return np.full((1, value.shape[1]), np.nan)
        return np.where(due[tick] >= 0, times[np.maximum(due[tick], 0)], np.inf)[None]


def _due(track: TableTrack, buffer: float) -> NDArray[np.intp]:
    """Return at which tick each row comes, (ticks, rows); -1: later than the buffer reaches, or there is none."""
    times = track.clock.ticks(np.inf)
    assert track.arrival is not None
    come = np.isfinite(track.arrival) & (track.arrival - times[:, None] <= buffer + _SAME)
    found = np.searchsorted(times, np.where(come, track.arrival, times[0]) - _SAME * np.maximum(1.0, np.abs(times[-1])))
    return np.where(come, found, -1)
