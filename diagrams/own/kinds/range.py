"""Distances as a kind of measurement."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.own.kinds.by_platform import AtStations
from quietfix.diagrams.own.kinds.kind import ExcessPath
from quietfix.diagrams.paths.places import Places
from quietfix.systems.documented import number
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.distance import Range as RangeModel

__all__ = ["Range"]


@dataclass
class Range(AtStations):
    """Distances."""

    row = "range"

    sigma_m: float = number("standard deviation [m]", 10.0, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``range_PLATFORM`` [m]."""
        return RangeModel(self.sigma_m, self.numbers(places, where))

    def excess_path(self) -> ExcessPath:
        """See `MeasurementKind.excess_path`."""
        return ExcessPath(1.0)
