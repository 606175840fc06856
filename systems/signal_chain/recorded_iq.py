"""Recorded I/Q samples in the place of a simulated receiver."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.clocks import Clock
from quietfix.systems.iq.block import IqBlock
from quietfix.systems.signals import EnsembleBlock

__all__ = ["RecordedIq"]


class RecordedIq(EnsembleBlock):
    """Play a recording: at every tick, the samples about it.

    Output ``iq``, an `IqBlock` whose middle is the tick to within half a sample; between the ticks its samples are NaN.

    Parameters
    ----------
    recording : IqBlock or sequence of IqBlock
        All of it; its start is in the time of the diagram. Several where it has gaps: what is played comes from the one
        that the tick lies in, and where there is none, or too little of it, the samples are NaN.
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
        If the recording is shorter than a block, or its parts are not of one sample rate.
    """

    def __init__(
        self,
        recording: IqBlock | Sequence[IqBlock],
        clock: Clock,
        samples: int,
        margin: int = 0,
        name: str = "recorded",
    ) -> None:
        super().__init__(name)
        if samples < 1 or margin < 0:
            raise ValueError(f"{name}: {samples} samples with a margin of {margin} are not allowed; 1, and 0, or more")
        parts = [recording] if isinstance(recording, IqBlock) else list(recording)
        longest = max((part.size for part in parts), default=0)
        if longest < samples:
            raise ValueError(f"{name}: {longest} samples are not allowed; at least the {samples} of one block")
        if len({(part.sample_rate, part.trials) for part in parts}) > 1:
            raise ValueError(f"{name}: parts of several sample rates or numbers of trials are not allowed")
        self._parts, self._clock = parts, clock
        self._samples, self._margin = samples, margin
        first = parts[0]
        silence: NDArray[np.complexfloating] = np.full((first.trials, samples), np.nan, first.samples.dtype)
        self._silence = IqBlock(silence, first.sample_rate, first.centre_frequency, first.start_time)
        self.declare_abstract_output("iq", self._play, {self.time_ticket()})

    def _play(self, context: Context) -> IqBlock:
        return self.block_at(context.get_time())

    def block_at(self, time: float) -> IqBlock:
        """Return what is played at a time [s]."""
        if self._clock.index(time) is None:
            return self._silence
        # the part whose middle is nearest in terms of its own length: within it, at most half of that
        whole = min(self._parts, key=lambda part: abs(time - part.mid_time[0]) / part.duration)
        middle = (time - whole.start_time[0]) * whole.sample_rate
        first = round(middle - 0.5 * (self._samples - 1)) - self._margin
        low, high = max(first, 0), min(first + self._samples + 2 * self._margin, whole.size)
        if high - low < self._samples:
            return self._silence
        start = whole.start_time + low / whole.sample_rate
        return IqBlock(whole.samples[:, low:high], whole.sample_rate, whole.centre_frequency, start)
