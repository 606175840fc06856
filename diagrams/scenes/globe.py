"""Scenes put on the globe: places and directions in axes fixed to the rotating Earth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.quantities.frame import Frame
from quietfix.diagrams.scenes.scene import Scene
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.constants import EARTH_RATE
from quietfix.systems.earth.geodetic import enu_rotation, geodetic_to_ecef

__all__ = ["Globe", "check_origin", "globe_of", "origin_of"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Globe:
    """How the axes of a frame lie in those of the Earth.

    Attributes
    ----------
    origin : ndarray, shape (3,)
        Of the frame, in geocentric axes with z to the north pole and x to the zero meridian [m].
    rotations : ndarray, shape (3, 3) or (epochs, 3, 3)
        From the axes of the frame to those of the Earth.
    note : str
        What is to be known of it; empty where there is nothing.
    """

    origin: Array
    rotations: Array
    note: str = ""

    def placed(self, places: Array) -> Array:
        """Return places (epochs, 3) of the frame in the axes of the Earth [m]."""
        return np.asarray(self.origin + (self.rotations @ places[..., None])[..., 0])

    def turned(self, axes: Array) -> Array:
        """Return rotations (epochs, 3, 3) from other axes to those of the Earth, given those to the frame."""
        return np.asarray(self.rotations @ axes)


def origin_of(text: str) -> tuple[float, float, float]:
    """Return latitude and longitude [rad] and height [m] from ``LATITUDE,LONGITUDE[,HEIGHT]``, in degrees and metres.

    Raises
    ------
    UserError
        If it is something else.
    """
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) == 2:
        numbers.append(0.0)
    fits = len(numbers) == 3 and np.isfinite(numbers).all() and abs(numbers[0]) <= 90 and abs(numbers[1]) <= 360
    if not fits or abs(numbers[2]) > 1e7:
        raise UserError(f"--origin: {text} is not allowed; LATITUDE,LONGITUDE or LATITUDE,LONGITUDE,HEIGHT [deg, m]")
    return float(np.radians(numbers[0])), float(np.radians(numbers[1])), numbers[2]


def check_origin(frame: Frame, origin: str | None) -> None:
    """Check whether it is told where the origin of a frame is, if and only if it has to be.

    Raises
    ------
    UserError
        If it is not, or cannot be.
    """
    if origin is not None:
        origin_of(origin)
        if frame.name in ("earth_fixed", "inertial"):
            raise UserError(f"--origin: {origin} is not allowed; axes of this result go through the Earth's centre")
    elif frame.name == "local":
        raise UserError(
            "--czml: axes of a local frame may be anywhere on the Earth; say where their origin is with "
            "--origin LATITUDE,LONGITUDE"
        )


def globe_of(scene: Scene, origin: str | None, scenario: Mapping[str, Any]) -> Globe:
    """Return how the frame of a scene lies on the Earth.

    Axes through the Earth's centre are those of the Earth, or turn in them: the inertial frame is the Earth's at
    t = 0, so that places are turned by -omega t about z. A launch frame stands where its scenario has its site; a
    local one has to be told.

    Parameters
    ----------
    scene : Scene
    origin : str, optional
        See `origin_of`; where the origin of a flat frame is.
    scenario : mapping
        That of the result.

    Raises
    ------
    UserError
        If it is not known where the frame is, or it is but is given.
    """
    name = scene.frame.name
    check_origin(scene.frame, origin)
    if name == "earth_fixed":
        return Globe(np.zeros(3), np.eye(3))
    if name == "inertial":
        angle = -EARTH_RATE * scene.times
        c, s, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
        turns = np.moveaxis(np.array([[c, -s, zero], [s, c, zero], [zero, zero, zero + 1]]), -1, 0)
        return Globe(np.zeros(3), turns, "places are in Earth-fixed axes, which are those of the result at t = 0")
    site = scenario.get("site")
    standing = site if name == "launch" and isinstance(site, Mapping) else {}
    if origin is not None:
        latitude, longitude, height = origin_of(origin)
    elif {"latitude_deg", "longitude_deg"} <= set(standing):
        latitude, longitude = (float(np.radians(float(standing[f"{key}_deg"]))) for key in ("latitude", "longitude"))
        height = 0.0
    else:
        raise UserError("--czml: the result does not say where its launch site is; --origin LATITUDE,LONGITUDE does")
    level = enu_rotation(np.float64(latitude), np.float64(longitude)).T
    if name == "launch":  # x down-range, y up, z to the right of it
        azimuth = np.radians(float(standing.get("azimuth_deg", 90.0)))
        s, c = np.sin(azimuth), np.cos(azimuth)
        level = level @ np.array([[s, 0.0, c], [c, 0.0, -s], [0.0, 1.0, 0.0]])
    where = geodetic_to_ecef(latitude, longitude, height)
    told = f"{np.degrees(latitude):g}, {np.degrees(longitude):g} deg, {height:g} m"
    return Globe(np.asarray(where), np.asarray(level), f"the origin of the flat axes is at {told} (WGS-84)")
