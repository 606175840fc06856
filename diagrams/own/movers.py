"""What moves, or stands, in a system of one's own: platforms and targets, as scenario fields."""

# No `from __future__ import annotations` here: Drake's YAML loader needs the types themselves.
from dataclasses import dataclass

from systems.documented import documented, number

__all__ = [
    "Fixed",
    "Geodetic",
    "GreatCircle",
    "Kepler",
    "Mover",
    "PositionVelocity",
    "RandomMotion",
    "Straight",
    "Waypoints",
]


@dataclass
class Fixed:
    """Stands in local axes."""

    east_km: float = number("x, to the east [km]", 0.0)
    north_km: float = number("y, to the north [km]", 0.0)
    up_m: float = number("z, up [m]", 0.0)


@dataclass
class Geodetic:
    """Stands on the ellipsoid."""

    latitude_deg: float = number("geodetic latitude [deg]", 0.0, at_least=-90, at_most=90)
    longitude_deg: float = number("longitude [deg]", 0.0)
    height_m: float = number("height above the ellipsoid [m]", 0.0, at_least=-500)


@dataclass
class Straight:
    """Flies straight on in the axes of the frame."""

    position_km: list[float] = documented("x, y, z at t = 0 [km]", factory=lambda: [0.0, 0.0, 0.0])
    velocity_mps: list[float] = documented("its velocity [m/s]", factory=lambda: [0.0, 0.0, 0.0])


@dataclass
class Waypoints:
    """Flies by waypoints in local axes, at constant height and speed, with turns of constant rate."""

    points_km: list[list[float]] = documented("x (east) and y (north) of each waypoint [km]", factory=list)
    height_m: float = number("z [m]", 0.0)
    speed_mps: float = number("speed [m/s]", 50.0, above=0)
    turn_rate_degps: float = number("rate of the turns [deg/s]", 3.0, above=0)


@dataclass
class GreatCircle:
    """Keeps height and speed along a great circle of the ellipsoid."""

    latitude_deg: float = number("geodetic latitude at t = 0 [deg]", 0.0, at_least=-90, at_most=90)
    longitude_deg: float = number("longitude at t = 0 [deg]", 0.0)
    height_m: float = number("height above the ellipsoid [m]", 0.0, at_least=-500)
    course_deg: float = number("course at t = 0, clockwise from north [deg]", 90.0)
    speed_mps: float = number("speed [m/s]", 10.0, at_least=0)


@dataclass
class Kepler:
    """A satellite by Kepler elements at t = 0; inertial and Earth-fixed axes coincide then."""

    semi_major_axis_km: float = number("semi-major axis [km]", 7078.137, above=0)
    eccentricity: float = number("eccentricity", 0.0, at_least=0, at_most=0.9)
    inclination_deg: float = number("inclination [deg]", 60.0)
    raan_deg: float = number("right ascension of the ascending node [deg]", 0.0)
    argument_of_perigee_deg: float = number("argument of perigee [deg]", 0.0)
    true_anomaly_deg: float = number("true anomaly at t = 0 [deg]", 0.0)


@dataclass
class PositionVelocity:
    """A satellite by its inertial position and velocity at t = 0."""

    position_km: list[float] = documented("inertial x, y, z [km]", factory=lambda: [7078.137, 0.0, 0.0])
    velocity_kmps: list[float] = documented("inertial vx, vy, vz [km/s]", factory=lambda: [0.0, 3.75, 6.5])


@dataclass
class RandomMotion:
    """Starts at random about another mover and goes on by the motion that the estimators believe in."""

    start: Fixed | Geodetic | Straight | Waypoints | GreatCircle | Kepler | PositionVelocity = documented(
        "where the mean of its state is at t = 0", factory=Fixed
    )
    sigma_position_m: float = number("standard deviation of the position per axis [m]", 0.0, at_least=0)
    sigma_velocity_mps: float = number("standard deviation of the velocity per axis [m/s]", 0.0, at_least=0)


Mover = Fixed | Geodetic | Straight | Waypoints | GreatCircle | Kepler | PositionVelocity
"""Whatever has a path of its own."""
