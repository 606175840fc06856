"""Where the targets of several tracks are, as functions of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.clocks import Times
from quietfix.systems.playback.tracks import Tracked

__all__ = ["TrackPaths"]

Array = NDArray[np.float64]


class TrackPaths(Tracked):
    """What is known of the target on each of several tracks, at all times; port ``state`` (1, 6).

    Parameters
    ----------
    tracks : sequence of Times
        The samples of each track.
    paths : sequence of callable
        ``at(time) -> (6,)`` of each: position [m] and velocity [m/s], NaN where nobody knows.
    name : str
        Name of the block.
    """

    def __init__(
        self, tracks: Sequence[Times], paths: Sequence[Callable[[float], Array]], name: str = "target"
    ) -> None:
        super().__init__(name, tracks)
        self._paths = list(paths)

        def state(context: Context) -> Array:
            track, _ = self.playing(context)
            return self._paths[track](context.get_time())[None]

        self.declare_output("state", 1, 6, state, self.track_tickets)
