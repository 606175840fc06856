"""Received frequencies as a kind of measurement."""

from __future__ import annotations

from dataclasses import dataclass, replace

from quietfix.diagrams.own.kinds.by_platform import AtStations
from quietfix.diagrams.own.kinds.kind import Alias, ExcessPath, Row
from quietfix.diagrams.paths.places import Places
from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.documented import number
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.frequency import Frequency as FrequencyModel

__all__ = ["Frequency"]


@dataclass
class Frequency(AtStations):
    """Received frequencies, less the carrier: Doppler and, where the scenario has one, the emitter's oscillator."""

    row = "frequency"

    sigma_hz: float = number("standard deviation [Hz]", 1.0, above=0)
    carrier_mhz: float = number("nominal carrier frequency [MHz]", 400.0, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``frequency_PLATFORM`` [Hz]."""
        return FrequencyModel(self.sigma_hz, self.carrier_mhz * 1e6, self.numbers(places, where), places.bias)

    def rows(self, places: Places, model: MeasurementModel) -> list[Row]:
        """See `MeasurementKind.rows`: a table may have the whole frequency, too."""
        carrier = self.carrier_mhz * 1e6
        return [
            replace(
                row,
                aliases=(Alias("doppler"), Alias("received_frequency", offset=-carrier)),
                largest=0.5 * carrier,
                largest_words=f"counted from the carrier of {carrier:g} Hz, a whole one is kind received_frequency",
                carrier=carrier,
            )
            for row in super().rows(places, model)
        ]

    def excess_path(self) -> ExcessPath:
        """See `MeasurementKind.excess_path`."""
        carrier = self.carrier_mhz * 1e6
        return ExcessPath(-carrier / SPEED_OF_LIGHT, True, carrier)
