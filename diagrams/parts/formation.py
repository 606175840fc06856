"""Satellites in formation and an emitter below them: scenario fields and blocks of the systems that have both."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.documented import documented, number
from quietfix.systems.earth.frames import inertial_to_earth_fixed
from quietfix.systems.geometry.visibility import ElevationMask
from quietfix.systems.plants.orbit import DenseOrbit
from quietfix.systems.trajectories.gravity import GravityConstants
from quietfix.systems.trajectories.kepler import KeplerElements, mean_anomaly, state_of

__all__ = [
    "EarthConstants",
    "GreatCircle",
    "Kepler",
    "Motion",
    "Offset",
    "PositionVelocity",
    "RandomAcceleration",
    "ReferenceOrbit",
    "StraightLine",
    "gravity_constants",
    "initial_state",
    "satellite_orbit",
    "satellite_states",
    "seen_at_all",
]

Array = NDArray[np.float64]

_KM = 1e3


@dataclass
class EarthConstants:
    """Physical constants."""

    mu_m3ps2: float = number("gravitational parameter of the Earth [m^3/s^2]", 3.986004418e14, above=0)
    earth_radius_m: float = number("equatorial radius of the Earth [m]", 6378137.0, at_least=1e5, at_most=1e8)
    j2: float = number("second zonal harmonic; 0 is two-body motion", 1.0826261e-3, at_least=-0.1, at_most=0.1)
    earth_rate_radps: float = number("rotation rate of the Earth [rad/s]", 7.292115e-5)


@dataclass
class ReferenceOrbit:
    """A circular orbit with ascending node 0, argument of latitude 0 at t = 0."""

    altitude_km: float = number("height above the equatorial radius [km]", 700.0, above=0)
    inclination_deg: float = number("inclination [deg]", 60.0, above=0, at_most=179.9)


@dataclass
class Offset:
    """A satellite in a circular orbit beside the reference orbit."""

    along_km: float = number("ahead of the reference along the track [km]", 0.0)
    across_km: float = number("to the right of the track at the node, by a shifted node [km]", 0.0)


@dataclass
class Kepler:
    """A satellite by Kepler elements at t = 0; inertial and Earth-fixed axes coincide then."""

    semi_major_axis_km: float = number("semi-major axis [km]", 7078.137, above=0)
    eccentricity: float = number("eccentricity", 0.0, at_least=0, at_most=0.9)
    inclination_deg: float = number("inclination [deg]", 60.0)
    raan_deg: float = number("right ascension of the ascending node [deg]", 0.0)
    argument_of_perigee_deg: float = number("argument of perigee [deg]", 0.0)
    true_anomaly_deg: float = number("true anomaly [deg]", 0.0)


@dataclass
class PositionVelocity:
    """A satellite by its inertial position and velocity at t = 0."""

    position_km: list[float] = documented("inertial x, y, z [km]", factory=lambda: [7078.137, 0.0, 0.0])
    velocity_kmps: list[float] = documented("inertial vx, vy, vz [km/s]", factory=lambda: [0.0, 3.75, 6.5])


@dataclass
class StraightLine:
    """A straight line in Earth-fixed axes, as the filter's model has it."""


@dataclass
class GreatCircle:
    """Constant height and speed along a great circle."""


@dataclass
class RandomAcceleration:
    """The filter's own kind of motion: velocity drawn per trial, process noise; for consistency tests."""

    acceleration_mps2: float = number("standard deviation of the acceleration in a step [m/s^2]", 0.1, at_least=0)
    sigma_velocity_mps: float = number("standard deviation of the initial velocity [m/s]", 400.0, at_least=0)


Motion = StraightLine | GreatCircle | RandomAcceleration
"""How an emitter may move."""


class Formation(Protocol):
    """What a scenario with satellites has."""

    duration_s: float
    constants: EarthConstants
    reference_orbit: ReferenceOrbit
    satellites: list[Offset | Kepler | PositionVelocity]


def gravity_constants(constants: EarthConstants) -> GravityConstants:
    """Return the physical constants of a scenario as the orbit's equations take them."""
    return GravityConstants(
        mu=constants.mu_m3ps2, radius=constants.earth_radius_m, j2=constants.j2, earth_rate=constants.earth_rate_radps
    )


def satellite_states(scenario: Formation, count: int) -> Array:
    """Return the satellites' inertial states at t = 0, shape (count, 6).

    Raises
    ------
    UserError
        If there are not `count`, or as `initial_state`.
    """
    if len(scenario.satellites) != count:
        raise UserError(f"satellites: {len(scenario.satellites)} are given; exactly {count} are needed")
    constants = gravity_constants(scenario.constants)
    return np.array(
        [
            initial_state(satellite, scenario.reference_orbit, constants, f"satellites.{i}")
            for i, satellite in enumerate(scenario.satellites)
        ]
    )


def initial_state(
    satellite: Offset | Kepler | PositionVelocity, reference: ReferenceOrbit, constants: GravityConstants, where: str
) -> Array:
    r"""Return a satellite's inertial state at t = 0, shape (6,).

    Parameters
    ----------
    satellite : Offset, Kepler or PositionVelocity
    reference : ReferenceOrbit
        What offsets refer to: ahead by an arc of the orbit, across by a node shifted by
        :math:`\Delta\Omega = d/(a \sin i)`, which moves the satellite along by
        :math:`a\,\Delta\Omega \cos i`, taken back.
    constants : GravityConstants
    where : str
        Name of the field, for messages.

    Raises
    ------
    UserError
        If a position or a velocity is not three finite numbers.
    """
    if isinstance(satellite, PositionVelocity):
        for field in ("position_km", "velocity_kmps"):
            value = getattr(satellite, field)
            if len(value) != 3 or not np.all(np.isfinite(value)):
                raise UserError(f"{where}.{field}: {list(value)} is not allowed; 3 finite numbers")
        return _KM * np.array([*satellite.position_km, *satellite.velocity_kmps])
    if isinstance(satellite, Offset):
        a = constants.radius + reference.altitude_km * _KM
        inclination = math.radians(reference.inclination_deg)
        node = satellite.across_km * _KM / a / math.sin(inclination)
        latitude = satellite.along_km * _KM / a - node * math.cos(inclination)
        return state_of(KeplerElements(a, 0.0, inclination, node, 0.0, latitude), constants.mu)
    elements = KeplerElements(
        satellite.semi_major_axis_km * _KM,
        satellite.eccentricity,
        math.radians(satellite.inclination_deg),
        math.radians(satellite.raan_deg),
        math.radians(satellite.argument_of_perigee_deg),
        mean_anomaly(math.radians(satellite.true_anomaly_deg), satellite.eccentricity),
    )
    return state_of(elements, constants.mu)


def satellite_orbit(scenario: Formation, count: int) -> DenseOrbit:
    """Return the block of the `count` satellites.

    Raises
    ------
    UserError
        As `satellite_states`.
    """
    constants = gravity_constants(scenario.constants)
    states = satellite_states(scenario, count)
    return DenseOrbit(states, scenario.duration_s, constants=constants, j2=constants.j2 != 0, name="satellites")


def seen_at_all(scenario: Formation, orbit: DenseOrbit, target: Array, mask: ElevationMask) -> bool:
    """Return whether any satellite sees the target (6,) at any time, if it flies straight on."""
    times = np.linspace(0.0, scenario.duration_s, 31)
    platforms = inertial_to_earth_fixed(orbit.at(times), times[:, None], scenario.constants.earth_rate_radps)
    moving = target + times[:, None] * np.concatenate([target[3:], np.zeros(3)])
    return bool(mask.visible(moving, platforms).any())
