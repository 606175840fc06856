"""The link that brings the auxiliary satellite's samples to the main one."""

from __future__ import annotations

import math

from pydrake.systems.framework import Context

from quietfix.systems.iq.block import IqBlock
from quietfix.systems.iq.quantise import quantise
from quietfix.systems.signals import EnsembleBlock

__all__ = ["InterSatelliteLink"]


class InterSatelliteLink(EnsembleBlock):
    r"""Input and output ``iq``: delayed, with the known delay taken out of the time tags again, and quantised.

    Samples carry the time at which the auxiliary satellite's clock saw them. A delay that is known does not change it;
    what is not known of it (of link and clock) is an error of the TDOA of the same size. That the samples arrive later
    than the instant they belong to is not simulated: the main satellite computes after the event.

    .. math:: t' = t + \delta - \delta_{\mathrm{assumed}}, \qquad x' = Q_b(x)

    Parameters
    ----------
    delay : float
        [s]
    assumed_delay : float, optional
        What the main satellite takes out [s]; by default all of it.
    bits : int, optional
        Of each of I and Q, see `quantise`; by default not quantised.
    full_scale : float
        Clipping level in standard deviations.
    name : str
        Name of the block.
    """

    def __init__(
        self,
        delay: float = 0.0,
        assumed_delay: float | None = None,
        bits: int | None = None,
        full_scale: float = 4.0,
        name: str = "inter_satellite_link",
    ) -> None:
        super().__init__(name)
        self._error = delay - (delay if assumed_delay is None else assumed_delay)
        if not math.isfinite(self._error):
            raise ValueError(f"delay, assumed_delay: {delay}, {assumed_delay} are not allowed; finite numbers")
        self._bits, self._full_scale = bits, full_scale
        if bits is not None:
            quantise(IqBlock([[1j]], 1.0, 0.0).samples, bits, full_scale)  # says what is wrong with them
        self.declare_abstract_input("iq", IqBlock)
        self.declare_abstract_output("iq", self._carry, {self.input_ticket("iq")})

    def _carry(self, context: Context) -> IqBlock:
        block: IqBlock = self.read_abstract(context, "iq")
        if self._bits is None and self._error == 0:
            return block
        samples = block.samples if self._bits is None else quantise(block.samples, self._bits, self._full_scale)
        return IqBlock(samples, block.sample_rate, block.centre_frequency, block.start_time + self._error)
