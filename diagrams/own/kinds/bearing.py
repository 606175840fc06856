"""Azimuth and elevation as a kind of measurement."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from quietfix.diagrams.own.kinds.by_platform import AtPlatform
from quietfix.diagrams.own.kinds.kind import Alias, Row
from quietfix.diagrams.parts.impairment import Mount
from quietfix.diagrams.paths.places import Places
from quietfix.diagrams.quantities.frame import Frame
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.angles.bearing import Bearing as BearingModel
from quietfix.systems.angles.horizon import HorizonBearing
from quietfix.systems.documented import number
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["Bearing", "with_limits"]

_LIMITS = {
    "azimuth": (2 * np.pi * (1 + 1e-9), "at most a turn either way"),
    "elevation": (np.pi / 2, "at most a right angle either way"),
}


def with_limits(rows: Sequence[Row]) -> list[Row]:
    """Return rows with the largest values that an azimuth and an elevation can have."""
    limits = [_LIMITS.get(row.kind, (0.0, "")) for row in rows]
    return [replace(row, largest=most, largest_words=words) for row, (most, words) in zip(rows, limits, strict=True)]


@dataclass
class Bearing(AtPlatform):
    """Azimuth and elevation at one platform, in local axes or over its horizon."""

    directions = "a !Bearing in local axes"

    sigma_deg: float = number("standard deviation of the azimuth [deg]", 1.0, above=0)
    sigma_elevation_deg: float | None = number("that of the elevation [deg]; null: none is measured", None, above=0)

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``azimuth_PLATFORM``, ``elevation_PLATFORM`` [rad]."""
        if places.frame.up is None:
            raise UserError(f"{where}: !Bearing is not allowed in frame {places.frame.name}; local or earth_fixed")
        kind = BearingModel if places.frame.flat else HorizonBearing
        elevation = None if self.sigma_elevation_deg is None else math.radians(self.sigma_elevation_deg)
        return kind(math.radians(self.sigma_deg), elevation, self.number(places, where))

    def rows(self, places: Places, model: MeasurementModel) -> list[Row]:
        """See `MeasurementKind.rows`: a table may have the azimuth as a bearing."""
        azimuth, *others = with_limits(super().rows(places, model))
        return [replace(azimuth, aliases=(Alias("bearing", compass=True),)), *others]

    def mounts(self, model: MeasurementModel, rows: Sequence[str], frame: Frame) -> list[Mount]:
        """See `MeasurementKind.mounts`."""
        return [Mount(rows, model.platform)] if isinstance(model, BearingModel) and frame.flat else []
