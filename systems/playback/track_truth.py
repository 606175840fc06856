"""Truth of recorded tracks, sample by sample."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.systems.framework import Context

from quietfix.systems.clocks import Times
from quietfix.systems.playback.tracks import Tracked

__all__ = ["TrackTruth"]


class TrackTruth(Tracked):
    """What is known of the target on each of several tracks; port ``state``, NaN between the samples.

    Parameters
    ----------
    tracks : sequence of Times
        The samples of each track.
    states : sequence of array_like, shape (samples, n)
        The target at each of them; NaN where nobody knows.
    name : str
        Name of the block.

    Raises
    ------
    ValueError
        For shapes that do not fit each other.
    """

    def __init__(self, tracks: Sequence[Times], states: Sequence[ArrayLike], name: str = "target") -> None:
        super().__init__(name, tracks)
        self._states = [np.array(one, dtype=float) for one in states]
        size = self._states[0].shape[-1]
        lengths = [one.ticks(np.inf).size for one in tracks]
        if [one.shape for one in self._states] != [(length, size) for length in lengths]:
            raise ValueError(f"{name}: states are not allowed without {size} numbers at each sample of a track")
        gap = np.full((1, size), np.nan)

        def state(context: Context) -> NDArray[np.float64]:
            track, sample = self.playing(context)
            return gap if sample is None else self._states[track][sample][None]

        self.declare_output("state", 1, size, state, self.track_tickets)
