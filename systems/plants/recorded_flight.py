"""A recorded flight as truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context

from quietfix.systems.signals import EnsembleBlock
from quietfix.systems.trajectories.planar_flight import PlanarFlight

__all__ = ["RecordedFlight"]

Array = NDArray[np.float64]


class RecordedFlight(EnsembleBlock):
    """Truth shared by all trials, from a smoothed record.

    Ports, all outputs, as those of `Rocket`: ``state`` (1, 6), ``acceleration`` (1, 3), ``stage`` (1, 1), the number
    of jumps of the acceleration so far.

    Parameters
    ----------
    flight : PlanarFlight
        The flight.
    name : str
        Name of the block.
    """

    def __init__(self, flight: PlanarFlight, name: str = "rocket") -> None:
        super().__init__(name)
        self.flight = flight
        ticket = {self.time_ticket()}
        self.declare_output("state", 1, 6, lambda c: self.at(c.get_time())[0][None], ticket)
        self.declare_output("acceleration", 1, 3, lambda c: self.at(c.get_time())[1][None], ticket)
        self.declare_output("stage", 1, 1, self._stage, ticket, [("stage", "1")])

    def again(self) -> RecordedFlight:
        """Return such a block for another diagram."""
        return RecordedFlight(self.flight, self.get_name())

    def at(self, time: float) -> tuple[Array, Array]:
        """Return state (6,) and acceleration (3,) at `time` [s]; NaN off the record."""
        return self.flight.at(time)

    def _stage(self, context: Context) -> Array:
        return np.array([[float(np.searchsorted(self.flight.breaks[1:-1], context.get_time(), side="right"))]])
