"""A rocket's path in a system of one's own."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.parts import launch
from quietfix.diagrams.paths.movers import Rocket
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.geodetic import geodetic_to_ecef
from quietfix.systems.plants.rocket import Rocket as RocketPlant
from quietfix.systems.trajectories.gravity import GravityConstants

__all__ = ["rocket_path"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class _Launch:
    """See `quietfix.diagrams.parts.launch.Launch`."""

    stop_s: float
    constants: launch.SphericalEarth
    site: launch.Site
    vehicle: Rocket
    stations: Sequence[launch.Track | launch.Geodetic] = ()


def rocket_path(rocket: Rocket, duration: float, constants: GravityConstants, where: str) -> Callable[[float], Array]:
    """Return a rocket's Earth-fixed state as a function of time.

    The launch frame stands on a sphere about the Earth's centre through the site on the ellipsoid: gravity, the Earth's
    rotation and the place of the site are then right, and states are turned and moved into Earth-fixed axes exactly.

    Raises
    ------
    UserError
        If the rocket cannot fly like that.
    """
    place = geodetic_to_ecef(math.radians(rocket.latitude_deg), math.radians(rocket.longitude_deg), 0.0)
    radius = float(np.linalg.norm(place))
    geocentric = math.degrees(math.asin(place[2] / radius))
    flight = _Launch(
        duration,
        launch.SphericalEarth(constants.mu, radius, constants.earth_rate),
        launch.Site(geocentric, rocket.longitude_deg, rocket.azimuth_deg),
        rocket,
    )
    try:
        plant = launch.vehicle_block(flight)
    except UserError as error:
        raise UserError(f"{where}{re.sub(r'^(vehicle.|rocket: )', lambda m: _SHOWN[m[1]], str(error))}") from error
    assert isinstance(plant, RocketPlant)
    site = launch.launch_site(flight)
    axes, centre = site.axes, site.centre

    def at(t: float) -> Array:
        state = plant.at(t)[0]
        return np.concatenate([(state[:3] - centre) @ axes, state[3:] @ axes])

    return at


_SHOWN = {"vehicle.": ".", "rocket: ": ": "}
