"""What had been measured, looked back on when all of it has come, for an estimator that looks back too."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.late.arrived import Clearing
from quietfix.systems.signals import EnsembleBlock

__all__ = ["Complete"]

Array = NDArray[np.float64]


class Complete(EnsembleBlock):
    """Measurements at the instant at which they were made, those alone that come before the end of the run.

    Inputs ``measurement`` (trials, rows), as it was made, ``arrival`` (trials, rows), when each will come [s], and with
    clearings ``platforms`` and ``prediction``, fed back from the estimator that takes what comes out. Output
    ``measurement``.

    Parameters
    ----------
    rows : int
        Of what was measured.
    clearings : sequence of Clearing
        What makes of them those that the estimator takes.
    trials, platforms, platform_trials, states : int
    name : str
        Name of the block.
    """

    def __init__(
        self,
        rows: int,
        clearings: Sequence[Clearing],
        trials: int,
        platforms: int,
        platform_trials: int,
        states: int,
        name: str,
    ) -> None:
        super().__init__(name)
        self._clearings, self._platforms = list(clearings), platforms
        ports = {"measurement": (trials, rows), "arrival": (trials, rows)}
        if clearings:
            ports |= {"platforms": (platform_trials, 6 * platforms), "prediction": (trials, states)}
        for port, shape in ports.items():
            self.declare_input(port, *shape)
        size = len(clearings[-1].stream) if clearings else rows
        tickets = {self.input_ticket(port) for port in ports}
        self.declare_output("measurement", trials, size, self._calc, tickets)

    def _calc(self, context: Context) -> Array:
        come = np.isfinite(self.read(context, "arrival"))
        stream = np.where(come, self.read(context, "measurement"), np.nan)
        for clearing in self._clearings:
            platforms = self.read(context, "platforms").reshape(-1, self._platforms, 6)
            stream, _ = clearing.cleared(stream, self.read(context, "prediction"), platforms)
        return stream
