"""Recorded measurements in the sensor's place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.bus import Bus
from quietfix.systems.clocks import Merged, Times
from quietfix.systems.playback.track_truth import TrackTruth
from quietfix.systems.sensors.recorded import RecordedMeasurements, Recording

__all__ = ["RecordedStream"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RecordedStream:
    """What was measured, by whom, and what is known of the target.

    Several tracks are played one after the other in time, each from a context of its own: nothing happens within a
    track but at its own samples. Publishes ``measurement``, ``platforms``, ``noise_covariance`` where R comes with the
    measurement, and ``truth``.

    Attributes
    ----------
    tracks : sequence of Recording
        One trial each, in the time of the recording.
    truth : sequence of ndarray, shape (samples, n)
        The target at the samples of each track; NaN where nobody knows.
    """

    tracks: Sequence[Recording]
    truth: Sequence[Array]

    @cached_property
    def played(self) -> list[Recording]:
        """The tracks, one after the other in time, by whole seconds later or earlier."""
        if len(self.tracks) == 1:
            return list(self.tracks)
        found, free = [], 0.0
        for track in self.tracks:
            later = free - np.floor(track.times[0])
            found.append(track.shifted(later))
            free = float(np.ceil(track.times[-1] + later)) + 1.0
        return found

    @property
    def clocks(self) -> list[Times]:
        """When each track is played."""
        return [track.clock for track in self.played]

    @property
    def times(self) -> list[Array]:
        """The samples of each track in the time of the recording [s]."""
        return [track.times for track in self.tracks]

    @cached_property
    def clock(self) -> Times:
        """The samples of all tracks together."""
        return Times(Merged(self.clocks).ticks(np.inf))

    @property
    def duration(self) -> float:
        """Time of the last sample of all [s]."""
        return float(self.clock.ticks(np.inf)[-1])

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        block = RecordedMeasurements(self.played)
        if bus.trials != block.trials:
            raise ValueError(f"trials: {bus.trials} at once are not allowed; a recording plays {block.trials}")
        bus.add(block, gives={name: name for name in block.output_names()})
        bus.add(TrackTruth(self.clocks, self.truth), gives={"truth": "state"})
