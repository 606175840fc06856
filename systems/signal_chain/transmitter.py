"""The emitter's transmitter: a waveform with its carrier and the run's random symbols."""

from __future__ import annotations

from pydrake.systems.framework import Context

from quietfix.systems.iq.waveform import Emission, Waveform, positive_number
from quietfix.systems.signals import EnsembleBlock

__all__ = ["Transmitter"]


class Transmitter(EnsembleBlock):
    """Output ``emission`` (abstract, an `Emission`): what receivers evaluate at the times at which it was sent.

    The symbols depend on the seed of the run and on the block's name. All trials hear the same ones, so that the part
    without noise is made once where all trials share the truth.

    Parameters
    ----------
    waveform : Waveform
        The complex envelope.
    carrier : float
        Carrier frequency [Hz], > 0.
    name : str
        Name of the block.
    """

    def __init__(self, waveform: Waveform, carrier: float, name: str = "transmitter") -> None:
        super().__init__(name)
        positive_number(carrier, "carrier", "Hz")
        self.waveform, self.carrier = waveform, carrier
        draw = self.declare_draw()
        self.declare_abstract_output("emission", self._send, {draw})

    def _send(self, context: Context) -> Emission:
        return Emission(self.waveform, self.carrier, self.draw(context).seed, self.noise_name())
