"""What one satellite measures of another as a kind of measurement."""

from __future__ import annotations

import math
from dataclasses import dataclass

from quietfix.diagrams.own.kinds.bearing import with_limits
from quietfix.diagrams.own.kinds.by_platform import AtPlatform
from quietfix.diagrams.own.kinds.kind import Row
from quietfix.diagrams.paths.places import Places
from quietfix.diagrams.quantities.frame import INERTIAL
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.angles.relative_kinematics import ROWS, RelativeKinematics
from quietfix.systems.documented import number, text
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["Relative"]


@dataclass
class Relative(AtPlatform):
    """What a satellite measures of another one, in inertial axes; null: that is not measured."""

    platform: str = text("the one that measures; empty: the first")
    sigma_azimuth_deg: float | None = number("standard deviation of the azimuth [deg]", 0.05, above=0)
    sigma_elevation_deg: float | None = number("of the elevation [deg]", 0.05, above=0)
    sigma_azimuth_rate_degps: float | None = number("of the azimuth's rate [deg/s]", None, above=0)
    sigma_elevation_rate_degps: float | None = number("of the elevation's rate [deg/s]", None, above=0)
    sigma_radial_velocity_mps: float | None = number("of the radial velocity [m/s]", None, above=0)
    sigma_radial_acceleration_mps2: float | None = number(
        "of the radial acceleration, of a target that falls [m/s^2]", None, above=0
    )

    def model(self, places: Places, where: str) -> MeasurementModel:
        """Return the measurement model; rows ``azimuth_PLATFORM`` [rad] to ``radial_acceleration_PLATFORM`` [m/s^2]."""
        if places.frame is not INERTIAL:
            raise UserError(f"{where}: !Relative is for frame inertial only, this is {places.frame.name}")
        suffixes = {"rad": ("deg", math.radians(1.0)), "rad/s": ("degps", math.radians(1.0)), "m/s": ("mps", 1.0)}
        sigmas = {}
        for row, unit in ROWS.items():
            suffix, scale = suffixes.get(unit, ("mps2", 1.0))
            sigma = getattr(self, f"sigma_{row}_{suffix}")
            if sigma is not None:
                sigmas[row] = sigma * scale
        if not sigmas:
            raise UserError(f"{where}: nothing is measured; at least one sigma_ is needed")
        return RelativeKinematics(sigmas, places.constants, places.constants.j2 != 0, self.number(places, where))

    def rows(self, places: Places, model: MeasurementModel) -> list[Row]:
        """See `MeasurementKind.rows`."""
        return with_limits(super().rows(places, model))
