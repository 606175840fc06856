"""A launch: the vehicle that flies and the stations that see it, in the launch frame of a spherical Earth."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.documented import choice, documented, number
from quietfix.systems.plants.recorded_flight import RecordedFlight
from quietfix.systems.plants.rocket import Rocket as RocketPlant
from quietfix.systems.trajectories.rocket import LaunchSite, RocketModel
from quietfix.systems.trajectories.rocket import Stage as RocketStage

__all__ = [
    "Falcon9",
    "Geodetic",
    "Launch",
    "Rocket",
    "Site",
    "SphericalEarth",
    "Stage",
    "Track",
    "launch_site",
    "rocket_model",
    "station_names",
    "station_positions",
    "vehicle_block",
]

Array = NDArray[np.float64]

_KM = 1e3
_DEEPEST = 500.0  # m below the sphere; the lowest land is at -430 m


@dataclass
class SphericalEarth:
    """Physical constants."""

    mu_m3ps2: float = number("gravitational parameter of the Earth [m^3/s^2]", 3.986004418e14, above=0)
    earth_radius_m: float = number("radius of the spherical Earth [m]", 6371e3, at_least=1e5, at_most=1e8)
    earth_rate_radps: float = number("rotation rate of the Earth [rad/s]", 7.292115e-5)


@dataclass
class Site:
    """Where the launch frame stands."""

    latitude_deg: float = number("latitude [deg]", 38.85, at_least=-90, at_most=90)
    longitude_deg: float = number("longitude [deg]", 111.61)
    azimuth_deg: float = number("of X, clockwise from north [deg]", 190.0)


@dataclass
class Stage:
    """A stage of a rocket."""

    dry_t: float = number("mass without propellant [t]", 1.0, above=0)
    propellant_t: float = number("propellant [t]", 10.0, above=0)
    thrust_kn: float = number("thrust in vacuum [kN]", 100.0, above=0)
    mass_flow_kgps: float = number("propellant used at full thrust [kg/s]", 30.0, above=0)
    ignition_s: float = number("when it ignites [s]", 0.0, at_least=0)
    cutoff_s: float | None = number("when it is cut off [s]; null: when the propellant is used up", None, above=0)
    nozzle_area_m2: float = number("pressure loss over air pressure [m^2]", 0.0, at_least=0)


@dataclass
class Rocket:
    """A rocket of several stages on a pitch program."""

    stages: list[Stage] = documented("stages in the order of their burning", factory=list)
    payload_t: float = number("payload [t]", 2.0, above=0)
    fairing_t: float = number("fairing [t]", 1.5, at_least=0)
    fairing_drop_s: float = number("when the fairing is dropped [s]", 200.0, above=0)
    separation_s: float = number("a burnt-out stage is dropped this long after cut-off [s]", 1.0, at_least=0)
    ramp_s: float = number("thrust rises and falls within this time [s]", 0.2, above=0)
    reference_area_m2: float = number("area of the drag [m^2]", 8.8, at_least=0)
    pitch_times_s: list[float] = documented("knots of the pitch program [s]", factory=lambda: [0.0, 400.0])
    pitch_deg: list[float] = documented("pitch above the horizontal of the site [deg]", factory=lambda: [90.0, 0.0])
    yaw_deg: float = number("final yaw towards -Z, turned in from 12 to 42 s [deg]", 1.0)


@dataclass
class Falcon9:
    """The recorded flight of a Falcon 9 (speed and altitude off the webcast), read from the data folder."""

    flight: str = choice("which flight", "Iridium_NEXT_6", ("Iridium_NEXT_6",))
    smoothing_s: float = number("width of the smoothing of speed and altitude [s]", 4.0, above=0)
    largest_gap_s: float = number("telemetry with a longer gap is refused [s]", 2.0, above=0)


@dataclass
class Track:
    """A station by its place beside the ground track."""

    down_km: float = number("down-range along the launch azimuth [km]", 0.0)
    cross_km: float = number("across, towards +Z [km]", 0.0)
    height_m: float = number("height [m]", 0.0)


@dataclass
class Geodetic:
    """A station by latitude and longitude on the spherical Earth."""

    latitude_deg: float = number("latitude [deg]", 38.85, at_least=-90, at_most=90)
    longitude_deg: float = number("longitude [deg]", 111.61)
    height_m: float = number("height [m]", 0.0)


class Launch(Protocol):
    """What vehicle and stations need of a scenario."""

    @property
    def stop_s(self) -> float:
        """Tracking ends [s]."""

    @property
    def constants(self) -> SphericalEarth:
        """Physical constants."""

    @property
    def site(self) -> Site:
        """Origin and axes of the launch frame."""

    @property
    def vehicle(self) -> Rocket | Falcon9:
        """What flies."""

    @property
    def stations(self) -> Sequence[Track | Geodetic]:
        """Who sees it."""


def launch_site(scenario: Launch) -> LaunchSite:
    """Return the launch frame."""
    site, constants = scenario.site, scenario.constants
    return LaunchSite(
        math.radians(site.latitude_deg),
        math.radians(site.longitude_deg),
        math.radians(site.azimuth_deg),
        constants.earth_radius_m,
        constants.earth_rate_radps,
    )


def rocket_model(scenario: Launch) -> RocketModel:
    """Return the rocket's equations of motion.

    Raises
    ------
    UserError
        If the vehicle is not a `Rocket`.
    """
    v = scenario.vehicle
    if not isinstance(v, Rocket):
        raise UserError(f"vehicle: {type(v).__name__} is recorded; equations of motion are for !Rocket")
    stages = [
        RocketStage(
            1e3 * s.dry_t,
            1e3 * s.propellant_t,
            1e3 * s.thrust_kn,
            s.mass_flow_kgps,
            s.ignition_s,
            math.inf if s.cutoff_s is None else s.cutoff_s,
            s.nozzle_area_m2,
        )
        for s in v.stages
    ]
    return RocketModel(
        launch_site(scenario),
        stages,
        1e3 * v.payload_t,
        1e3 * v.fairing_t,
        v.fairing_drop_s,
        v.pitch_times_s,
        np.radians(v.pitch_deg),
        math.radians(v.yaw_deg),
        v.reference_area_m2,
        v.ramp_s,
        v.separation_s,
        scenario.constants.mu_m3ps2,
    )


def station_positions(scenario: Launch) -> Array:
    """Return the stations in the launch frame [m], shape (stations, 3).

    Raises
    ------
    UserError
        If there is none, or one is inside the Earth.
    """
    if not scenario.stations:
        raise UserError("stations: none is given; at least one is needed")
    site, places = launch_site(scenario), []
    for i, station in enumerate(scenario.stations):
        if station.height_m < -_DEEPEST:
            raise UserError(
                f"stations.{i}.height_m: {station.height_m:g} is not allowed; the station would be inside the Earth "
                f"(>= {-_DEEPEST:g} m)"
            )
        if isinstance(station, Track):
            places.append(site.from_track(station.down_km * _KM, station.cross_km * _KM, station.height_m))
        else:
            angles = math.radians(station.latitude_deg), math.radians(station.longitude_deg)
            places.append(site.from_geodetic(*angles, station.height_m))
    return np.array(places)


def station_names(scenario: Launch) -> list[str]:
    """Return what the stations are called: a scenario lists them without names, and so do the rows of a range rate."""
    return [f"station_{i}" for i in range(len(scenario.stations))]


_FIELDS = {  # those that only a whole rocket can be told to be wrong in
    "ignition": "ignition_s",
    "propellant": "propellant_t",
    "thrust": "thrust_kn",
}


def vehicle_block(scenario: Launch) -> RocketPlant | RecordedFlight:
    """Return the block with the ports state, acceleration and stage.

    Raises
    ------
    UserError
        If the rocket cannot fly like that, in the scenario's names.
    """
    if isinstance(scenario.vehicle, Rocket):
        try:
            return RocketPlant(rocket_model(scenario), scenario.stop_s, name="rocket")
        except ValueError as error:
            said = re.sub(r"^stages\.(\d+)\.(\w+):", lambda m: f"stages.{m[1]}.{_FIELDS.get(m[2], m[2])}:", str(error))
            said = said.replace("pitch program:", "pitch_times_s, pitch_deg:")
            raise UserError(said if said.startswith("rocket:") else f"vehicle.{said}") from error
    from quietfix.diagrams.readers.falcon9 import falcon9_plant

    return falcon9_plant(scenario.vehicle, launch_site(scenario), scenario.stop_s)
