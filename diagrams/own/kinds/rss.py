"""Received powers as a kind of measurement."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.own.kinds.by_platform import AtStations
from quietfix.diagrams.paths.places import Places
from quietfix.systems.documented import number
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.received_power import ReceivedPower

__all__ = ["Rss"]


@dataclass
class Rss(AtStations):
    """Received powers of an emitter of known power, by the log-distance law."""

    row = "rss"

    sigma_db: float = number("standard deviation of the shadowing [dB]", 4.0, above=0)
    power_dbm: float = number("power received at 1 m, extrapolated from the far field [dBm]", -30.0)
    exponent: float = number("exponent of the path loss; 2 in free space", 2.0, above=0, at_most=10)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``rss_PLATFORM`` [dBm]."""
        return ReceivedPower(self.sigma_db, self.power_dbm, self.exponent, self.numbers(places, where))
