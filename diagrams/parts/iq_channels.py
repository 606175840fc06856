"""Channels of I/Q recordings that were sampled together: their phases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from quietfix.diagrams.assembly.bus import Bus
from quietfix.systems.ambiguity.prefilter import Prefilter
from quietfix.systems.clocks import Clock
from quietfix.systems.iq.block import IqBlock
from quietfix.systems.signal_chain.channel_phases import ChannelPhaseSensor
from quietfix.systems.signal_chain.recorded_iq import RecordedIq

__all__ = ["IqChannels", "channel_name"]


def channel_name(receiver: str, channel: int) -> str:
    """Return the name of a channel of a receiver, counted from 0."""
    return f"{receiver}_ch{channel + 1}"


@dataclass(frozen=True, eq=False)
class IqChannels:
    """Blocks for the channels of each receiver that has several; publishes ``phase_CHANNEL`` of all but the first.

    Attributes
    ----------
    receivers : mapping of str to sequence of sequence of IqBlock
        Parts without a gap of each channel.
    prefilter : Prefilter
        What all pass.
    clock : Clock
        When they are compared.
    samples : int
        That are integrated.
    """

    receivers: Mapping[str, Sequence[Sequence[IqBlock]]]
    prefilter: Prefilter
    clock: Clock
    samples: int

    @property
    def signals(self) -> list[str]:
        """Names of the signals."""
        return [
            f"phase_{channel_name(name, i)}"
            for name, channels in self.receivers.items()
            for i in range(1, len(channels))
        ]

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        for name, channels in self.receivers.items():
            names = [channel_name(name, i) for i in range(len(channels))]
            for one, parts in zip(names, channels, strict=True):
                bus.add(RecordedIq(parts, self.clock, self.samples, 0, one))
            for other in names[1:]:
                block = ChannelPhaseSensor(self.prefilter, self.clock, 1, f"{other} - {names[0]}")
                heard = {"first": f"{names[0]}.iq", "second": f"{other}.iq"}
                bus.add(block, gives={f"phase_{other}": "phase"}, takes=heard)
