"""What kinds have in common that are measured between platforms, at each of several, or at one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from quietfix.diagrams.own.kinds.kind import MeasurementKind, Row
from quietfix.diagrams.paths.places import Places
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.documented import documented, text
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["AtPlatform", "AtStations", "Differences", "wave_of"]


def wave_of(light_time: bool, places: Places, where: str) -> dict[str, Any]:
    """Return the arguments of a model of one wave front; a `UserError` where the frame has none."""
    if light_time and not places.frame.geodetic:
        raise UserError(f"{where}.light_time: true is for frame earth_fixed only, this is {places.frame.name}")
    return {"light_time": light_time, "earth_rate": places.constants.earth_rate, "constants": places.constants}


@dataclass
class Differences(MeasurementKind):
    """Differences of a quantity between platforms and a reference; rows ``ROW_RECEIVER_REFERENCE``.

    Attributes
    ----------
    row : str
        What a table calls it.
    """

    row: ClassVar[str]

    reference: str = text("platform that the others are compared with; empty: the first one")
    receivers: list[str] = documented("the others; empty: all but the reference", factory=list)
    correlated: bool = documented("errors of differences correlated through the reference", False)
    light_time: bool = documented("of one wave front, instead of the geometry of one instant", False)

    def pairs(self, places: Places, where: str) -> tuple[list[int], int]:
        """Return the numbers of the receivers, and of the reference."""
        reference = places.or_first(self.reference)
        number = places.number(reference, f"{where}.reference")
        receivers = places.numbers(self.receivers, f"{where}.receivers", reference)
        if reference in receivers:
            raise UserError(f"{where}.receivers: {reference} is not allowed; it is the reference")
        return list(receivers.values()), number

    def common(self, places: Places, where: str) -> dict[str, Any]:
        """Return the arguments that the models have in common."""
        return {"correlated": self.correlated, **wave_of(self.light_time, places, where)}

    def rows(self, places: Places, model: MeasurementModel) -> list[Row]:
        """See `MeasurementKind.rows`."""
        reference = places.or_first(self.reference)
        receivers = self.receivers or [name for name in places.platforms if name != reference]
        return [
            Row(self.row, receiver, reference, unit, compares_clocks=self.compares_clocks)
            for receiver, unit in zip(receivers, model.units, strict=True)
        ]


@dataclass
class AtStations(MeasurementKind):
    """The same quantity at each of several platforms; rows ``ROW_PLATFORM``.

    Attributes
    ----------
    row : str
        What a table calls it.
    """

    row: ClassVar[str]

    stations: list[str] = documented("platforms that measure; empty: all", factory=list)

    def numbers(self, places: Places, where: str) -> list[int]:
        """Return the numbers of the platforms."""
        return list(places.numbers(self.stations, f"{where}.stations").values())

    def rows(self, places: Places, model: MeasurementModel) -> list[Row]:
        """See `MeasurementKind.rows`."""
        stations = self.stations or list(places.platforms)
        return [Row(self.row, station, "", unit) for station, unit in zip(stations, model.units, strict=True)]


@dataclass
class AtPlatform(MeasurementKind):
    """Quantities at one platform; rows ``NAME_PLATFORM`` by the names of the model's own rows."""

    platform: str = text("which one; empty: the first")

    def number(self, places: Places, where: str) -> int:
        """Return the number of the platform."""
        return places.number(places.or_first(self.platform), f"{where}.platform")

    def rows(self, places: Places, model: MeasurementModel) -> list[Row]:
        """See `MeasurementKind.rows`."""
        platform = places.or_first(self.platform)
        return [Row(name, platform, "", unit) for name, unit in zip(model.names, model.units, strict=True)]
