"""Time differences of arrival as a kind of measurement."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.own.kinds.by_platform import Differences
from quietfix.diagrams.own.kinds.kind import ExcessPath
from quietfix.diagrams.paths.places import Places
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.documented import number
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.tdoa import Tdoa as TdoaModel

__all__ = ["Tdoa"]


@dataclass
class Tdoa(Differences):
    """Time differences of arrival against a reference."""

    row = "tdoa"
    compares_clocks = True

    sigma_ns: float = number("standard deviation of a difference [ns]", 50.0, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``tdoa_RECEIVER_REFERENCE`` [s]."""
        return TdoaModel(self.sigma_ns * 1e-9, *self.pairs(places, where), **self.common(places, where))

    def excess_path(self) -> ExcessPath:
        """See `MeasurementKind.excess_path`."""
        return ExcessPath(1.0 / SPEED_OF_LIGHT)
