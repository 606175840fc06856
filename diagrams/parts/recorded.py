"""Recorded measurements in the sensor's place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from diagrams.assembly.bus import Bus
from systems.clocks import Merged, Times
from systems.plants.track_truth import TrackTruth
from systems.sensors.recorded import RecordedMeasurements, Recording

__all__ = ["RecordedStream"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RecordedStream:
    """What was measured, by whom, and what is known of the target.

    Publishes ``measurement``, ``platforms``, ``noise_covariance`` where R comes with the measurement, and ``truth``.

    Attributes
    ----------
    tracks : sequence of Recording
        One trial each.
    truth : sequence of ndarray, shape (samples, n)
        The target at the samples of each track; NaN where nobody knows.
    """

    tracks: Sequence[Recording]
    truth: Sequence[Array]

    @property
    def clock(self) -> Times:
        """The samples of all tracks together."""
        return Times(Merged([track.clock for track in self.tracks]).ticks(np.inf))

    @property
    def times(self) -> list[Array]:
        """The samples of each track [s]."""
        return [track.times for track in self.tracks]

    @property
    def duration(self) -> float:
        """Time of the last sample of all [s]."""
        return float(self.clock.ticks(np.inf)[-1])

    def __call__(self, bus: Bus) -> None:
        """See `diagrams.assembly.model.Part`."""
        block = RecordedMeasurements(self.tracks)
        if bus.trials != block.trials:
            raise ValueError(f"trials: {bus.trials} at once are not allowed; a recording plays {block.trials}")
        bus.add(block, gives={name: name for name in block.output_names()})
        bus.add(TrackTruth([track.clock for track in self.tracks], self.truth), gives={"truth": "state"})
