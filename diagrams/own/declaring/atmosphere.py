"""Measurement models of a system of one's own, with what the atmosphere adds to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from quietfix.diagrams.own.fields.atmosphere import Atmosphere
from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.own.kinds.kind import MeasurementKind, Row
from quietfix.diagrams.paths.places import Places
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.atmosphere.columns import Medium
from quietfix.systems.atmosphere.delayed import Delayed
from quietfix.systems.atmosphere.ionosphere import ThinShell
from quietfix.systems.atmosphere.troposphere import Troposphere
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["Air", "air_of", "unaffected"]


@dataclass(frozen=True)
class Air:
    """What signals pass.

    Attributes
    ----------
    field : Atmosphere
    where : str
        Its field, for messages.
    """

    field: Atmosphere
    where: str

    def added_to(
        self, model: MeasurementModel, kind: MeasurementKind, rows: Sequence[Row], places: Places, sensor: str
    ) -> MeasurementModel:
        """Return a sensor's model with what is added to it; as it is where nothing is, or its kind has no path.

        Raises
        ------
        UserError
            If the frequency is needed, and not known.
        """
        excess = kind.excess_path()
        media = [] if excess is None else self._media(excess.carrier, sensor)
        if excess is None or not media:
            return model
        receivers = [places.platforms[row.receiver] for row in rows]
        reference = places.platforms[rows[0].reference] if rows[0].reference else None
        return Delayed(model, media, receivers, reference, excess.scale, excess.doppler)

    def _media(self, carrier: float | None, sensor: str) -> list[Medium]:
        found: list[Medium] = []
        air, shell = self.field.troposphere, self.field.ionosphere
        if air is not None:
            found.append(Troposphere(air.pressure_hpa, air.temperature_c + 273.15, air.humidity_percent / 100))
        if shell is not None:
            if carrier is None and shell.carrier_mhz is not None:
                carrier = shell.carrier_mhz * 1e6
            if carrier is None:
                raise UserError(f"{self.where}.ionosphere.carrier_mhz: none is given; {sensor} needs it")
            found.append(ThinShell(shell.tec_tecu, shell.shell_km * 1e3, carrier))
        return found


def air_of(scenario: OwnScenario) -> tuple[Air, Air]:
    """Return what signals pass, and what the estimators believe that they pass.

    Raises
    ------
    UserError
        If there is any in a frame without the Earth below.
    """
    real = Air(scenario.atmosphere, "atmosphere")
    assumed = scenario.belief.atmosphere
    believed = real if assumed is None else Air(assumed, "belief.atmosphere")
    for one in (real, believed):
        if one.field != Atmosphere() and not scenario.axes.geodetic:
            raise UserError(f"{one.where}: it is for frame earth_fixed only, this is {scenario.frame}")
    return real, believed


def unaffected(scenario: OwnScenario, kinds: Mapping[str, tuple[MeasurementKind, MeasurementModel]]) -> str:
    """Return a note on what is measured as in vacuum although there is an atmosphere; empty: nothing is.

    Parameters
    ----------
    scenario : OwnScenario
    kinds : mapping of str to MeasurementKind and its model
        All that is measured, by name; what needs no platform, such as a height, has no path.
    """
    if all(one.field == Atmosphere() for one in air_of(scenario)):
        return ""
    names = [
        name
        for name, (kind, model) in kinds.items()
        if kind.excess_path() is None and model.platforms_used(len(scenario.platforms)).any()
    ]
    return f"atmosphere: {', '.join(names)} is as in vacuum; it adds to delays, ranges and Doppler." if names else ""
