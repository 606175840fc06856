"""Rates of distances as a kind of measurement."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.own.kinds.by_platform import AtStations
from quietfix.diagrams.own.kinds.kind import ExcessPath
from quietfix.diagrams.paths.places import Places
from quietfix.systems.documented import number
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.range_rate import RangeRate as RangeRateModel

__all__ = ["RangeRate"]


@dataclass
class RangeRate(AtStations):
    """Rates of the distances, positive away."""

    row = "range_rate"

    sigma_mps: float = number("standard deviation [m/s]", 0.1, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``range_rate_PLATFORM`` [m/s]."""
        return RangeRateModel(self.sigma_mps, self.numbers(places, where), places.bias)

    def excess_path(self) -> ExcessPath:
        """See `MeasurementKind.excess_path`."""
        return ExcessPath(1.0, doppler=True)
