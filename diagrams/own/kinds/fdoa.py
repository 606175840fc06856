"""Differences of received frequencies as a kind of measurement."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.own.kinds.by_platform import Differences
from quietfix.diagrams.own.kinds.kind import ExcessPath
from quietfix.diagrams.paths.places import Places
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.documented import documented, number
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.fdoa import Fdoa as FdoaModel

__all__ = ["Fdoa"]


@dataclass
class Fdoa(Differences):
    """Differences of the received frequency against a reference."""

    row = "fdoa"

    sigma_hz: float = number("standard deviation of a difference [Hz]", 1.0, above=0)
    carrier_mhz: float = number("carrier frequency [MHz]", 1000.0, above=0)
    paper_sign: bool = documented(
        "as a difference of range rates over the wavelength, which is the negative of that of frequencies", False
    )

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``fdoa_RECEIVER_REFERENCE`` [Hz]."""
        return FdoaModel(
            self.sigma_hz,
            self.carrier_mhz * 1e6,
            *self.pairs(places, where),
            paper_sign=self.paper_sign,
            **self.common(places, where),
        )

    def excess_path(self) -> ExcessPath:
        """See `MeasurementKind.excess_path`."""
        carrier = self.carrier_mhz * 1e6
        return ExcessPath((carrier if self.paper_sign else -carrier) / SPEED_OF_LIGHT, True, carrier)
