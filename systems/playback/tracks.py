"""Blocks that play one of several recorded tracks: one built diagram serves all of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from pydrake.systems.framework import BasicVector, Context, NumericParameterIndex, System

from quietfix.systems.clocks import Merged, Times
from quietfix.systems.signals import EnsembleBlock, leaf_systems

__all__ = ["Tracked", "play_track"]


class Tracked(EnsembleBlock):
    """A block that plays one of several tracks; a parameter of the context says which.

    Parameters
    ----------
    name : str
        Name of the block.
    tracks : sequence of Times
        The samples of each track.

    Attributes
    ----------
    clock : Times
        The samples of all tracks together: the clock of everything that reads this block.
    """

    def __init__(self, name: str, tracks: Sequence[Times]) -> None:
        super().__init__(name)
        self._tracks = list(tracks)
        # samples of two tracks that differ by rounding are one tick
        self.clock = Times(Merged(self._tracks).ticks(np.inf))
        self._sought, self._sought_at = 0, -math.inf
        self._found: int | None = None
        self._track = self.DeclareNumericParameter(BasicVector([0.0]))

    @property
    def track_tickets(self) -> set[Any]:
        """What a port depends on that plays a track."""
        return {self.time_ticket(), self.numeric_parameter_ticket(NumericParameterIndex(self._track))}

    def playing(self, context: Context) -> tuple[int, int | None]:
        """Return which track plays, and which of its samples is now; None between them."""
        # the parameter of a single track is 0: to look it up costs a third of playing a sample
        track = int(context.get_numeric_parameter(self._track).value()[0]) if len(self._tracks) > 1 else 0
        time = context.get_time()
        if time != self._sought_at or track != self._sought:  # the ports of a block are read one after the other
            self._found = self._tracks[track].index(time, self._found)
            self._sought, self._sought_at = track, time
        return track, self._found

    def select(self, root_context: Context, track: int) -> float:
        """Let a context play a track.

        Parameters
        ----------
        root_context : Context
            Context of the diagram, before the run; its time is set to the first sample.
        track : int
            Index of the track.

        Returns
        -------
        float
            Time of the last sample [s].
        """
        if not 0 <= track < len(self._tracks):
            raise ValueError(f"{self.get_name()}: track {track} is not allowed; 0 to {len(self._tracks) - 1}")
        mine = self.GetMyMutableContextFromRoot(root_context)
        mine.get_mutable_numeric_parameter(self._track).SetFromVector([float(track)])
        times, ticks = self._tracks[track].ticks(np.inf), self.clock.ticks(np.inf)
        first, last = (ticks[self.clock.index(time)] for time in times[[0, -1]])
        root_context.SetTime(first)
        return float(last)


def play_track(diagram: System, root_context: Context, track: int) -> float:
    """Let all blocks of a diagram play a track; return the time of its last sample [s].

    Raises
    ------
    ValueError
        If no block plays tracks.
    """
    players = [block for block in leaf_systems(diagram) if isinstance(block, Tracked)]
    if not players:
        raise ValueError("track: no block of the diagram plays tracks")
    return max(block.select(root_context, track) for block in players)
