"""Frames: what the axes of states and platforms mean, in one table."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.quantities.directions import (
    Directions,
    earth_directions,
    inertial_directions,
    launch_directions,
    local_directions,
)
from quietfix.diagrams.quantities.states import POSITION, VELOCITY
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.geodetic import course_speed, ecef_to_geodetic, enu_rotation, up

if TYPE_CHECKING:
    import xarray as xr

__all__ = [
    "EARTH_FIXED",
    "FRAMES",
    "INERTIAL",
    "LAUNCH",
    "LOCAL",
    "UNITS",
    "Frame",
    "Ground",
    "as_frame",
    "frame_of",
]

Array = NDArray[np.float64]

_KM = 1e3

UNITS = {"position": "m", "height": "m", "velocity": "m/s", "speed": "m/s", "course": "deg", "bias": "m/s"}
"""What errors and bounds are about, and in which unit: length of the error of position and velocity; height, horizontal
speed, course clockwise from north; bias, where it is in the state."""

_NEAREST_POLE = 0.05  # cosine of the latitude from which on a map is not stretched any further


@dataclass(frozen=True, eq=False)
class Ground:
    """The two axes along the ground as figures have them, the horizontal one of a figure first.

    Attributes
    ----------
    components : tuple of str
        Components of the place that they are made of.
    labels : (str, str)
        Of places, with units.
    places : callable
        ``(places, around)``, (time, axes) and (axes,) [m] -> (time, 2) in those units: a track without a jump, near to
        the other place.
    offset_labels : (str, str)
        Of differences of places, without units.
    offsets : callable
        ``(places, differences)``, both (..., axes) [m] -> (..., 2) [m].
    stretch : callable
        A place (axes,) -> length of a unit of the vertical axis, over that of the horizontal one.
    """

    components: tuple[str, ...]
    labels: tuple[str, str]
    places: Callable[[Array, Array], Array]
    offset_labels: tuple[str, str]
    offsets: Callable[[Array, Array], Array]
    stretch: Callable[[Array], float]


@dataclass(frozen=True, eq=False)
class Frame:
    """Axes of states and platforms.

    Attributes
    ----------
    name : str
        As users write it, and results carry it.
    up : callable or None
        Places (..., axes) -> unit vectors upwards (..., 3); None where heights mean nothing.
    height : callable or None
        Places (..., 3) -> heights (...) [m].
    course_and_speed : callable or None
        ``(places, velocities)`` (..., axes) -> course clockwise from north [rad] and horizontal speed [m/s].
    level : tuple of str
        Components of the state that course and horizontal speed are made of.
    directions : callable
        ``(place, velocity, platform)`` -> the words and unit vectors that a state is told in.
    ground : Ground or None
        Axes along the ground; None where no plane of the frame is the ground.
    map_names, map_labels : (str, str)
        What a map counts places by, the vertical axis first, and the same with units.
    flat : bool
        Whether straight lines along x and y stay at one height.
    geodetic : bool
        Whether it is fixed to the rotating Earth, and heights are above the ellipsoid.
    """

    name: str
    up: Callable[[Array], Array] | None
    height: Callable[[Array], Array] | None
    course_and_speed: Callable[[Array, Array], tuple[Array, Array]] | None
    level: tuple[str, ...]
    directions: Callable[[Array, Array, Array], Directions]
    ground: Ground | None
    map_names: tuple[str, str]
    map_labels: tuple[str, str]
    flat: bool = False
    geodetic: bool = False

    def __str__(self) -> str:
        """Return the name in words: ``earth-fixed``."""
        return self.name.replace("_", "-")

    def quantities(self, names: Collection[str]) -> dict[str, str]:
        """Return which of `UNITS` can be told of a state with components of these names, and in which unit."""
        has = set(names)
        there = {
            "position": bool(has & set(POSITION)),
            "height": self.height is not None and has >= set(POSITION),
            "velocity": bool(has & set(VELOCITY)),
            "speed": self.course_and_speed is not None and has >= set(self.level),
            "course": self.course_and_speed is not None and has >= set(self.level),
            "bias": "bias" in has,
        }
        return {what: unit for what, unit in UNITS.items() if there[what]}


# ------------------------------------------------------------------------------------------------- Earth-fixed axes


def _geodetic_height(places: Array) -> Array:
    return np.asarray(ecef_to_geodetic(places)[2])


def _geodetic_course(places: Array, velocities: Array) -> tuple[Array, Array]:
    course, speed = course_speed(places, velocities)[:2]
    return course, speed


def _longitude_latitude(places: Array, around: Array) -> Array:
    latitude, longitude, _ = ecef_to_geodetic(places)
    middle = np.degrees(np.nan_to_num(ecef_to_geodetic(around)[1]))
    across = np.degrees(np.unwrap(longitude))
    # within half a turn, so that what is together is drawn together, across the date line too
    across = across - 360 * np.round((across[:1] - middle) / 360)
    return np.stack([across, np.degrees(latitude)], axis=-1)


def _east_north(places: Array, differences: Array) -> Array:
    latitude, longitude, _ = ecef_to_geodetic(places)
    rotation = enu_rotation(np.nan_to_num(latitude), np.nan_to_num(longitude))
    with np.errstate(invalid="ignore"):
        return np.asarray((rotation @ differences[..., None])[..., :2, 0])


def _stretch_of_latitude(place: Array) -> float:
    return 1 / max(_NEAREST_POLE, float(np.cos(np.nan_to_num(ecef_to_geodetic(place)[0]))))


# ------------------------------------------------------------------------------------------------------- flat axes


def _z_is_up(places: Array) -> Array:
    return np.broadcast_to([0.0, 0.0, 1.0], (*places.shape[:-1], 3))


def _third(places: Array) -> Array:
    return places[..., 2]


def _level_course(places: Array, velocities: Array) -> tuple[Array, Array]:
    east, north = velocities[..., 0], velocities[..., 1]
    return np.arctan2(east, north), np.hypot(east, north)


def _plane(columns: list[int], components: tuple[str, str], words: tuple[str, str]) -> Ground:
    """Return two of the axes themselves as those along the ground."""
    return Ground(
        components=components,
        labels=(f"{words[0]} [km]", f"{words[1]} [km]"),
        places=lambda places, around: places[..., columns] / _KM,
        offset_labels=words,
        offsets=lambda places, differences: differences[..., columns],
        stretch=lambda place: 1.0,
    )


# ------------------------------------------------------------------------------------------------------- the table

EARTH_FIXED = Frame(
    name="earth_fixed",
    up=up,
    height=_geodetic_height,
    course_and_speed=_geodetic_course,
    level=(*POSITION, *VELOCITY),
    directions=earth_directions,
    ground=Ground(
        components=POSITION,
        labels=("longitude [deg]", "latitude [deg]"),
        places=_longitude_latitude,
        offset_labels=("east", "north"),
        offsets=_east_north,
        stretch=_stretch_of_latitude,
    ),
    map_names=("north", "east"),
    map_labels=("north of the scenario's target [km]", "east of it [km]"),
    geodetic=True,
)
"""Fixed to the Earth, through its centre; z to the north pole."""

LOCAL = Frame(
    name="local",
    up=_z_is_up,
    height=_third,
    course_and_speed=_level_course,
    level=VELOCITY[:2],
    directions=local_directions,
    ground=_plane([0, 1], ("x", "y"), ("east", "north")),
    map_names=("north", "east"),
    map_labels=("y, north [km]", "x, east [km]"),
    flat=True,
)
"""East, north and, where there is a third axis, up, on a flat Earth."""

INERTIAL = Frame(
    name="inertial",
    up=None,
    height=None,
    course_and_speed=None,
    level=(),
    directions=inertial_directions,
    ground=None,
    map_names=("across", "along"),
    map_labels=("across the target's orbit, left positive [km]", "along it [km]"),
)
"""Through the Earth's centre, and not turning with it."""

LAUNCH = Frame(
    name="launch",
    up=None,
    height=None,
    course_and_speed=None,
    level=(),
    directions=launch_directions,
    ground=_plane([0, 2], ("x", "z"), ("down-range X", "across Z")),
    map_names=("up", "down_range"),
    map_labels=("Y, up at the site [km]", "X, down-range [km]"),
    flat=True,
)
"""Earth-fixed axes at a launch site: x down-range, y up, z across to the right."""

FRAMES = {frame.name: frame for frame in (EARTH_FIXED, LOCAL, INERTIAL, LAUNCH)}
"""All of them by name."""


def as_frame(frame: Frame | str) -> Frame:
    """Return a frame by its name, or as it is.

    Raises
    ------
    UserError
        If there is none of that name.
    """
    if isinstance(frame, Frame):
        return frame
    if not isinstance(frame, str) or frame not in FRAMES:
        raise UserError(f"frame: {frame!r:.80} is not allowed; one of {', '.join(FRAMES)}")
    return FRAMES[frame]


def frame_of(dataset: xr.Dataset) -> Frame:
    """Return the frame of a study's result, Earth-fixed where it names none.

    Raises
    ------
    UserError
        If it names one that there is not.
    """
    return as_frame(dataset.attrs.get("frame", EARTH_FIXED))
