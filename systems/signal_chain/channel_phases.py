"""The block that compares channels which were sampled together: from I/Q samples to phases."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.ambiguity.channel_phase import channel_phase
from quietfix.systems.ambiguity.prefilter import Prefilter
from quietfix.systems.clocks import Clock
from quietfix.systems.iq.block import IqBlock
from quietfix.systems.signals import EnsembleBlock, check_trials

__all__ = ["ChannelPhaseSensor"]

Array = NDArray[np.float64]


class ChannelPhaseSensor(EnsembleBlock):
    r"""Compare two channels of one receiver.

    Inputs ``first`` and ``second`` (each an `IqBlock`), output ``phase`` (trials, 2): the phase of the second minus
    that of the first and its standard deviation [rad]; NaN between the ticks of the clock, and where samples are
    missing.

    .. math:: \phi = \arg\sum_k \bar X_k Y_k, \qquad
              \sigma_\phi^2 = \sum_k [\Im(C_k e^{-j\phi})]^2 \Big/ \Big[\sum_k \Re(C_k e^{-j\phi})\Big]^2

    Parameters
    ----------
    prefilter : Prefilter
        What both channels pass.
    clock : Clock
        When there are blocks to be compared.
    trials : int
        Trials of the samples.
    name : str
        Name of the block.
    """

    def __init__(self, prefilter: Prefilter, clock: Clock, trials: int, name: str = "channel_phase") -> None:
        super().__init__(name)
        self._prefilter, self._clock, self._trials = prefilter, clock, check_trials(trials)
        for port in ("first", "second"):
            self.declare_abstract_input(port, IqBlock)
        tickets = {self.time_ticket(), self.input_ticket("first"), self.input_ticket("second")}
        rows = (("phase", "rad"), ("sigma", "rad"))
        self.declare_output("phase", self._trials, 2, self._compare, tickets, rows)

    def _compare(self, context: Context) -> Array:
        if self._clock.index(context.get_time()) is None:
            return np.full((self._trials, 2), np.nan)
        first, second = (self.read_abstract(context, port) for port in ("first", "second"))
        return channel_phase(first, second, self._prefilter)
