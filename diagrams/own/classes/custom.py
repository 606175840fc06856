"""A user's own measurement model in a system of one's own."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.own.kinds.kind import MeasurementKind
from quietfix.diagrams.paths.places import Places
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.documented import documented, text
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.custom import CustomMeasurement, made

__all__ = ["Custom"]


@dataclass
class Custom(MeasurementKind):
    """A measurement model of one's own: ``!Custom {class: package.module:Class, options: {...}}``."""

    class_: str = text("where the class is: package.module:Class, beside this file, say")
    options: dict[str, bool | int | float | str] = documented("keyword arguments of the class", factory=dict)
    platforms: list[str] = documented("platforms that it is given, in this order; empty: all", factory=list)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows as the user's names them."""
        platforms = places.numbers(self.platforms, f"{where}.platforms")
        try:
            model, has_jacobian = made(self.class_, self.options)
        except ValueError as error:
            raise UserError(f"{where}.{error}") from error
        return CustomMeasurement(model, list(platforms.values()), has_jacobian, where, self.class_, UserError)
