"""The target's height as a kind of measurement."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.own.kinds.kind import MeasurementKind
from quietfix.diagrams.paths.places import Places
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.documented import number
from quietfix.systems.measurement.altitude import Altitude as AltitudeModel
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.component import Component

__all__ = ["Altitude"]


@dataclass
class Altitude(MeasurementKind):
    """The target's height, as it reports it or as it is assumed: above the ellipsoid, or z in local axes."""

    sigma_m: float = number("standard deviation [m]", 30.0, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; row ``altitude`` [m]."""
        if places.frame.height is None:
            raise UserError(f"{where}: !Altitude is not allowed in frame {places.frame.name}; local or earth_fixed")
        return Component(2, self.sigma_m, "altitude", "m") if places.frame.flat else AltitudeModel(self.sigma_m)
