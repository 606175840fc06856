"""Recorded I/Q samples in the place of a simulated receiver."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from systems.clocks import Clock
from systems.iq.block import IqBlock
from systems.signals import EnsembleBlock

__all__ = ["RecordedIq"]


class RecordedIq(EnsembleBlock):
    """Play a recording: at every tick, the samples about it.

    Output ``iq``, an `IqBlock` whose middle is the tick to within half a sample; between the ticks its samples are NaN.

    Parameters
    ----------
    recording : IqBlock
        All of it; its start is in the time of the diagram.
    clock : Clock
        When a block is taken from it.
    samples : int
        In a block.
    margin : int
        More samples on both sides, as far as there are any: of a receiver that others are compared with, none; of those
        that are compared with it, the largest delay.
    name : str
        Name of the block.

    Raises
    ------
    ValueError
        If the recording is shorter than a block.
    """

    def __init__(self, recording: IqBlock, clock: Clock, samples: int, margin: int = 0, name: str = "recorded") -> None:
        super().__init__(name)
        if samples < 1 or margin < 0:
            raise ValueError(f"{name}: {samples} samples with a margin of {margin} are not allowed; 1, and 0, or more")
        if recording.size < samples:
            raise ValueError(f"{name}: {recording.size} samples are not allowed; at least the {samples} of one block")
        self._recording, self._clock = recording, clock
        self._samples, self._margin = samples, margin
        silence: NDArray[np.complexfloating] = np.full((recording.trials, samples), np.nan, recording.samples.dtype)
        self._silence = IqBlock(silence, recording.sample_rate, recording.centre_frequency, recording.start_time)
        self.declare_abstract_output("iq", self._play, {self.time_ticket()})

    def _play(self, context: Context) -> IqBlock:
        time = context.get_time()
        if self._clock.index(time) is None:
            return self._silence
        whole = self._recording
        middle = (time - whole.start_time[0]) * whole.sample_rate
        first = round(middle - 0.5 * (self._samples - 1)) - self._margin
        low, high = max(first, 0), min(first + self._samples + 2 * self._margin, whole.size)
        if high <= low:
            return self._silence
        start = whole.start_time + low / whole.sample_rate
        return IqBlock(whole.samples[:, low:high], whole.sample_rate, whole.centre_frequency, start)
