"""Sensors of a system of one's own, as scenario fields, and the measurement models that they are."""

# No `from __future__ import annotations` here: Drake's YAML loader needs the types themselves.
import math
from dataclasses import dataclass
from typing import Any

from diagrams.errors import UserError
from diagrams.own.custom import Custom
from diagrams.own.places import Places, Timed
from systems.documented import documented, number, text
from systems.measurement.altitude import Altitude as AltitudeModel
from systems.measurement.base import MeasurementModel
from systems.measurement.bearing import Bearing as BearingModel
from systems.measurement.component import Component
from systems.measurement.distance import Range as RangeModel
from systems.measurement.fdoa import Fdoa as FdoaModel
from systems.measurement.frequency import Frequency as FrequencyModel
from systems.measurement.horizon import HorizonBearing
from systems.measurement.range_rate import RangeRate as RangeRateModel
from systems.measurement.tdoa import Tdoa as TdoaModel

__all__ = ["Altitude", "Bearing", "Custom", "Fdoa", "Frequency", "Places", "Range", "RangeRate", "Sensor", "Tdoa"]


@dataclass
class _Differenced(Timed):
    reference: str = text("platform that the others are compared with; empty: the first one")
    receivers: list[str] = documented("the others; empty: all but the reference", factory=list)
    correlated: bool = documented("errors of differences correlated through the reference", False)
    light_time: bool = documented("of one wave front, instead of the geometry of one instant", False)

    def _pairs(self, places: Places, where: str) -> tuple[str, int, dict[str, int]]:
        reference = self.reference or next(iter(places.platforms))
        number_ = places.number(reference, f"{where}.reference")
        receivers = places.numbers(self.receivers, f"{where}.receivers", reference)
        if reference in receivers:
            raise UserError(f"{where}.receivers: {reference} is not allowed; it is the reference")
        return reference, number_, receivers

    def _common(self, places: Places) -> dict[str, Any]:
        if self.light_time and places.frame != "earth_fixed":
            raise UserError("light_time: true is for frame earth_fixed only")
        rate = places.constants.earth_rate
        return {"correlated": self.correlated, "light_time": self.light_time, "earth_rate": rate}


@dataclass
class Tdoa(_Differenced):
    """Time differences of arrival against a reference."""

    sigma_ns: float = number("standard deviation of a difference [ns]", 50.0, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``tdoa_RECEIVER_REFERENCE`` [s]."""
        name, reference, receivers = self._pairs(places, where)
        model = TdoaModel(self.sigma_ns * 1e-9, list(receivers.values()), reference, **self._common(places))
        model.names = tuple(f"tdoa_{receiver}_{name}" for receiver in receivers)
        return model


@dataclass
class Fdoa(_Differenced):
    """Differences of the received frequency against a reference."""

    sigma_hz: float = number("standard deviation of a difference [Hz]", 1.0, above=0)
    carrier_mhz: float = number("carrier frequency [MHz]", 1000.0, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``fdoa_RECEIVER_REFERENCE`` [Hz]."""
        name, reference, receivers = self._pairs(places, where)
        carrier = self.carrier_mhz * 1e6
        model = FdoaModel(self.sigma_hz, carrier, list(receivers.values()), reference, **self._common(places))
        model.names = tuple(f"fdoa_{receiver}_{name}" for receiver in receivers)
        return model


@dataclass
class Range(Timed):
    """Distances."""

    stations: list[str] = documented("platforms that measure; empty: all", factory=list)
    sigma_m: float = number("standard deviation [m]", 10.0, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``range_PLATFORM`` [m]."""
        stations = places.numbers(self.stations, f"{where}.stations")
        model = RangeModel(self.sigma_m, list(stations.values()))
        model.names = tuple(f"range_{station}" for station in stations)
        return model


@dataclass
class RangeRate(Timed):
    """Rates of the distances, positive away."""

    stations: list[str] = documented("platforms that measure; empty: all", factory=list)
    sigma_mps: float = number("standard deviation [m/s]", 0.1, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``range_rate_PLATFORM`` [m/s]."""
        stations = places.numbers(self.stations, f"{where}.stations")
        model = RangeRateModel(self.sigma_mps, list(stations.values()), places.bias)
        model.names = tuple(f"range_rate_{station}" for station in stations)
        return model


@dataclass
class Frequency(Timed):
    """Received frequencies, less the carrier: Doppler and, where the scenario has one, the emitter's oscillator."""

    stations: list[str] = documented("platforms that measure; empty: all", factory=list)
    sigma_hz: float = number("standard deviation [Hz]", 1.0, above=0)
    carrier_mhz: float = number("nominal carrier frequency [MHz]", 400.0, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``frequency_PLATFORM`` [Hz]."""
        stations = places.numbers(self.stations, f"{where}.stations")
        model = FrequencyModel(self.sigma_hz, self.carrier_mhz * 1e6, list(stations.values()), places.bias)
        model.names = tuple(f"frequency_{station}" for station in stations)
        return model


@dataclass
class Bearing(Timed):
    """Azimuth and elevation at one platform, in local axes or over its horizon."""

    platform: str = text("which one; empty: the first")
    sigma_deg: float = number("standard deviation of the azimuth [deg]", 1.0, above=0)
    sigma_elevation_deg: float | None = number("that of the elevation [deg]; null: none is measured", None, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``azimuth_PLATFORM``, ``elevation_PLATFORM`` [rad]."""
        if places.frame == "inertial":
            raise UserError(f"{where}: !Bearing is not allowed in frame inertial; local or earth_fixed")
        name = self.platform or next(iter(places.platforms))
        number_ = places.number(name, f"{where}.platform")
        kind = BearingModel if places.frame == "local" else HorizonBearing
        elevation = None if self.sigma_elevation_deg is None else math.radians(self.sigma_elevation_deg)
        model = kind(math.radians(self.sigma_deg), elevation, number_)
        model.names = tuple(f"{row}_{name}" for row in model.names)
        return model


@dataclass
class Altitude(Timed):
    """The target's height, as it reports it or as it is assumed: above the ellipsoid, or z in local axes."""

    sigma_m: float = number("standard deviation [m]", 30.0, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; row ``altitude`` [m]."""
        if places.frame == "inertial":
            raise UserError(f"{where}: !Altitude is not allowed in frame inertial; local or earth_fixed")
        return Component(2, self.sigma_m, "altitude", "m") if places.frame == "local" else AltitudeModel(self.sigma_m)


Sensor = Tdoa | Fdoa | Range | RangeRate | Frequency | Bearing | Altitude | Custom
"""Whatever measures."""
