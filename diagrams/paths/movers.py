"""What moves, or stands, in a system of one's own: platforms and targets, as scenario fields."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.parts import launch
from quietfix.diagrams.parts.formation import Kepler, Offset, PositionVelocity
from quietfix.systems.documented import documented, number, text

__all__ = [
    "Fixed",
    "Geodetic",
    "Gpx",
    "GreatCircle",
    "Kepler",
    "Mover",
    "Oem",
    "Offset",
    "Platform",
    "PositionVelocity",
    "RandomMotion",
    "Rocket",
    "Sp3",
    "Straight",
    "StraightLine",
    "Tle",
    "Track",
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
class StraightLine:
    """Flies straight on in Earth-fixed axes, level at t = 0: after 100 km it is 0.8 km higher above the ellipsoid."""

    latitude_deg: float = number("geodetic latitude at t = 0 [deg]", 0.0, at_least=-90, at_most=90)
    longitude_deg: float = number("longitude at t = 0 [deg]", 0.0)
    height_m: float = number("height above the ellipsoid at t = 0 [m]", 0.0, at_least=-500)
    course_deg: float = number("course at t = 0, clockwise from north [deg]", 90.0)
    speed_mps: float = number("speed [m/s]", 10.0, at_least=0)


@dataclass
class Waypoints:
    """Flies by waypoints at constant height and speed, with turns of constant rate.

    Over the ellipsoid the legs are great circles; speed and turn rate are those at the first waypoint, and within 1 %
    afterwards.
    """

    points_km: list[list[float]] = documented("local axes: x (east) and y (north) of each [km]", factory=list)
    points_deg: list[list[float]] = documented("else: geodetic latitude and longitude of each [deg]", factory=list)
    height_m: float = number("z, or height above the ellipsoid [m]", 0.0, at_least=-500)
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
class Tle:
    """A satellite by two-line elements (SGP4), from the scenario's start_utc on.

    The inertial axes are true-equator, mean-equinox ones (TEME) turned by Greenwich mean sidereal time at start_utc.
    """

    line_1: str = text("first line, of 69 characters")
    line_2: str = text("second line, of 69 characters")


@dataclass
class Sp3:
    """A satellite by its precise orbit in an SP3 file."""

    file: str = text("path, relative to the scenario's file")
    satellite: str = text("such as G05 or L27; empty: the only one in the file")
    start_s: float | None = number(
        "t = 0 is so long after the first epoch of the file [s]; null: at start_utc, or at that epoch without one",
        None,
        at_least=0,
    )


@dataclass
class Oem:
    """A satellite by a CCSDS Orbit Ephemeris Message (KVN).

    Its axes are Earth-fixed (ITRF of any year, WGS84, EFG), EME2000 (J2000), GCRF, ICRF or TEME. All but the first are
    turned by precession, nutation and sidereal time, without the motion of the pole: within 20 m in a low orbit, and
    0.5 m more for every millisecond of UT1 that is not said. No segment is interpolated into the next one.
    """

    file: str = text("path, relative to the scenario's file")
    start_s: float | None = number(
        "t = 0 is so long after the file's first (useable) epoch [s]; null: at start_utc, or at that epoch without one",
        None,
        at_least=0,
    )
    ut1_minus_utc_s: float = number(
        "of the day (IERS Bulletin A); Earth-fixed axes need none [s]", 0.0, at_least=-1, at_most=1
    )


@dataclass
class Gpx:
    """A recorded track of a GPX file.

    Its heights are above the geoid, as receivers write them: the file's own geoidheight is added, or geoid_m. Between
    the points it is a cubic Hermite spline; between two segments is a gap.
    """

    file: str = text("path, relative to the scenario's file")
    track: str = text("its name; empty: the only one in the file")
    geoid_m: float = number("height of the geoid above the ellipsoid, where the file does not say it [m]", 0.0)
    height_m: float | None = number("height above the ellipsoid instead of the file's [m]", None)


@dataclass
class Platform:
    """A row, or the rows, of a table of platforms: a CSV file, with any delimiter, whose first line names the columns.

    name; latitude_deg, longitude_deg, height_m on the ellipsoid, or x_m, y_m, z_m in the axes of the frame; of what
    moves, time (ISO 8601 with its zone) or time_s [s], and if known vx_mps, vy_mps, vz_mps. Several rows of a name are
    one track, as of !Track.
    """

    file: str = text("path, relative to the scenario's file")
    name: str = text("which; empty: the only one in the table")


@dataclass
class Track:
    """A recorded track: a CSV file whose first line names the columns.

    time_s [s], or time (ISO 8601; t = 0 is start_utc, or the first one of the file without it); x_m, y_m, z_m in the
    axes of the frame and, if known, vx_mps, vy_mps, vz_mps; or latitude_deg, longitude_deg, height_m on the ellipsoid.
    Between the samples it is a cubic Hermite spline.
    """

    file: str = text("path, relative to the scenario's file")


@dataclass
class Rocket(launch.Rocket):
    """A rocket that lifts off at t = 0 from the ellipsoid.

    It flies about a sphere that has the Earth's centre, axis and rotation and passes through the site. Its "up" at the
    site is away from the Earth's centre, at most 0.19 deg off the vertical of the ellipsoid, and the height that it
    meets air and ground at is above that sphere: off the height above the ellipsoid by 0 at the site and up to 3.4 m
    per km flown north or south, at a latitude of 45 deg.
    """

    latitude_deg: float = number("geodetic latitude of the site [deg]", 0.0, at_least=-90, at_most=90)
    longitude_deg: float = number("longitude of the site [deg]", 0.0)
    azimuth_deg: float = number("launch azimuth, clockwise from north [deg]", 90.0)


Mover = (
    Fixed
    | Geodetic
    | Straight
    | StraightLine
    | Waypoints
    | GreatCircle
    | Kepler
    | PositionVelocity
    | Offset
    | Tle
    | Sp3
    | Oem
    | Gpx
    | Platform
    | Track
    | Rocket
)
"""Whatever has a path of its own."""


@dataclass
class RandomMotion:
    """Starts at random about another mover and goes on by the motion that the estimators believe in."""

    start: Mover = documented("where the mean of its state is at t = 0", factory=Fixed)
    sigma_position_m: float = number("standard deviation of the position per axis [m]", 0.0, at_least=0)
    sigma_velocity_mps: float = number("standard deviation of the velocity per axis [m/s]", 0.0, at_least=0)
