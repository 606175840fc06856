"""Physical constants that more than one room needs."""

__all__ = [
    "EARTH_MU",
    "EARTH_RATE",
    "SPEED_OF_LIGHT",
    "WGS84_AXIS",
    "WGS84_ECCENTRICITY_SQUARED",
    "WGS84_FLATTENING",
]

SPEED_OF_LIGHT = 299_792_458.0
"""Speed of light in vacuum [m/s]."""

EARTH_RATE = 7.292115e-5
"""Rotation rate of the Earth [rad/s] (WGS-84)."""

EARTH_MU = 3.986004418e14
"""Gravitational parameter of the Earth [m^3/s^2] (WGS-84)."""

WGS84_AXIS = 6378137.0
"""Semi-major axis of the WGS-84 ellipsoid [m]."""

WGS84_FLATTENING = 1 / 298.257223563
"""Flattening of the WGS-84 ellipsoid."""

WGS84_ECCENTRICITY_SQUARED = WGS84_FLATTENING * (2 - WGS84_FLATTENING)
"""First eccentricity squared of the WGS-84 ellipsoid."""
