"""Planes over which a target's course is moved about as a whole: flat ones, and shells around the Earth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.diagrams.quantities.frame import Frame, as_frame
from quietfix.diagrams.quantities.states import POSITION, columns
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.earth.geodetic import ecef_to_geodetic, enu_rotation, geodetic_to_ecef
from quietfix.systems.earth.geodetic import up as normal

__all__ = ["Chart", "Flat", "Shell", "Upright", "chart_of", "moved_to"]

Array = NDArray[np.float64]

_TARGET = "the scenario's target"
_UPRIGHT = {
    "east_up": (("up", "east"), ("height [km]", "east of the middle [km]"), 1),
    "north_up": (("up", "north"), ("height [km]", "north of the middle [km]"), 0),
}
_VECTORS = ("", "v", "a")  # what stands before x, y, z in the names of the components of position, velocity ...


class Chart(Protocol):
    """Counts places along two axes, the vertical one of a figure first, and moves a course to such a place."""

    @property
    def names(self) -> tuple[str, str]:
        """What the two axes are called."""

    @property
    def labels(self) -> tuple[str, str]:
        """The same with units."""

    @property
    def middle(self) -> Array:
        """Coordinates of the start of the scenario's target, shape (2,) [m]."""

    @property
    def furthest(self) -> float:
        """How far from there the chart is of use [m]."""

    def coordinates(self, places: Array) -> Array:
        """Return the coordinates (..., 2) [m] of places (..., axes), projected on the plane."""

    def moved(self, course: Array, names: Sequence[str], to: Array) -> Array:
        """Return a course (time, n) of components `names` moved so that it starts at `to` (..., 2) [m].

        The course is carried along as a rigid whole; shape (..., time, n).
        """


@dataclass(frozen=True, eq=False)
class Flat:
    """The x-y plane at the height of the target: courses are translated.

    Parameters
    ----------
    names, labels : (str, str)
    middle : ndarray, shape (2,)
        Where the scenario's target starts, y before x [m].
    """

    names: tuple[str, str]
    labels: tuple[str, str]
    middle: Array
    furthest: float = np.inf

    def coordinates(self, places: Array) -> Array:
        """See `Chart.coordinates`."""
        return places[..., 1::-1]

    def moved(self, course: Array, names: Sequence[str], to: Array) -> Array:
        """See `Chart.moved`."""
        found = np.broadcast_to(course, (*to.shape[:-1], *course.shape)).copy()
        found[..., columns(names, ("y", "x"))] += (to - self.middle)[..., None, :]
        return found


@dataclass(frozen=True, eq=False)
class Shell:
    r"""A shell around the Earth through the target: at its geodetic height, or at its distance from the centre.

    A place is counted as an arc on the sphere through the target: with :math:`\theta` its length over the radius and t
    its direction at the target's radial unit vector :math:`u_0`, it is at :math:`u = u_0\cos\theta + t\sin\theta`.
    Earth-fixed courses keep their height and their direction in east, north and up; inertial ones are turned about the
    Earth's centre, which leaves a Keplerian orbit one.

    Parameters
    ----------
    names, labels : (str, str)
    place : ndarray, shape (3,)
        Where the scenario's target starts [m].
    axes : ndarray, shape (2, 3)
        Unit vectors of the vertical and the horizontal axis there, across the radius.
    geodetic : bool
        Whether the axes are Earth-fixed, and heights those above the ellipsoid.
    """

    names: tuple[str, str]
    labels: tuple[str, str]
    place: Array
    axes: Array
    geodetic: bool

    @property
    def middle(self) -> Array:
        """The target's start has coordinates zero."""
        return np.zeros(2)

    @property
    def furthest(self) -> float:
        """Half a radian: 3200 km on the ground."""
        return 0.5 * self._radius

    @property
    def _radius(self) -> float:
        return float(np.linalg.norm(self.place))

    def coordinates(self, places: Array) -> Array:
        """See `Chart.coordinates`."""
        level = places @ self.axes.T
        length = np.linalg.norm(level, axis=-1, keepdims=True)
        arc = self._radius * np.arctan2(length, (places @ (self.place / self._radius))[..., None])
        return arc * level / np.where(length > 0, length, 1.0)

    def moved(self, course: Array, names: Sequence[str], to: Array) -> Array:
        """See `Chart.moved`."""
        return _carried(course, names, self.place, *self._turned(to))

    def _turned(self, to: Array) -> tuple[Array, Array]:
        """Return the place (..., 3) at coordinates (..., 2), and the rotation (..., 3, 3) of the course there."""
        length = np.linalg.norm(to, axis=-1)[..., None]
        ahead = (to @ self.axes) / np.where(length > 0, length, 1.0)
        up, angle = self.place / self._radius, length / self._radius
        radial = np.cos(angle) * up + np.sin(angle) * ahead
        if self.geodetic:
            height, origin = ecef_to_geodetic(self.place)[2], enu_rotation(*ecef_to_geodetic(self.place)[:2])
            latitude, longitude, _ = ecef_to_geodetic(self._radius * radial)
            turn = np.swapaxes(enu_rotation(latitude, longitude), -1, -2) @ origin
            return geodetic_to_ecef(latitude, longitude, height), turn
        # Rodrigues' formula about up x ahead, in terms of the two
        outer = ahead[..., :, None] * up - up[:, None] * ahead[..., None, :]
        both = up[:, None] * up + ahead[..., :, None] * ahead[..., None, :]
        turn = np.eye(3) + np.sin(angle)[..., None] * outer - (1 - np.cos(angle))[..., None] * both
        return self._radius * radial, turn


@dataclass(frozen=True, eq=False)
class Upright:
    """An upright plane through the middle of a level one: heights over the way to the east or to the north.

    Parameters
    ----------
    level : Flat or Shell
        In local or Earth-fixed axes.
    place : ndarray, shape (3,)
        Where the scenario's target starts [m].
    plane : {'east_up', 'north_up'}
    """

    level: Flat | Shell
    place: Array
    plane: str

    @property
    def names(self) -> tuple[str, str]:
        """What the two axes are called."""
        return _UPRIGHT[self.plane][0]

    @property
    def labels(self) -> tuple[str, str]:
        """The same with units."""
        return _UPRIGHT[self.plane][1]

    @property
    def middle(self) -> Array:
        """Height of the target's start, and 0."""
        return np.array([self._heights(self.place), 0.0])

    @property
    def furthest(self) -> float:
        """As on the level plane."""
        return self.level.furthest

    def _heights(self, places: Array) -> Array:
        flat = isinstance(self.level, Flat)
        return np.asarray(places[..., 2] if flat else ecef_to_geodetic(places)[2], dtype=float)

    def coordinates(self, places: Array) -> Array:
        """See `Chart.coordinates`."""
        along = _UPRIGHT[self.plane][2]
        level = self.level.coordinates(places)[..., along] - self.level.middle[along]
        return np.stack([self._heights(places), level], axis=-1)

    def moved(self, course: Array, names: Sequence[str], to: Array) -> Array:
        """See `Chart.moved`."""
        beside = np.broadcast_to(self.level.middle, to.shape).copy()
        beside[..., _UPRIGHT[self.plane][2]] += to[..., 1]
        found = self.level.moved(course, names, beside)
        return _lifted(found, names, to[..., 0] - self._heights(self.place), isinstance(self.level, Shell))


def _carried(course: Array, names: Sequence[str], place: Array, start: Array, turn: Array) -> Array:
    """Return a course (time, n) from `place`, turned by (..., 3, 3), that starts at (..., 3); (..., time, n)."""
    found = np.broadcast_to(course, (*start.shape[:-1], *course.shape)).copy()
    for letter in _VECTORS:
        parts = [letter + axis for axis in POSITION]
        if not set(parts) <= set(names):
            continue
        at = columns(names, parts)
        vectors = course[..., at] - (place if letter == "" else 0.0)
        carried = np.einsum("...ij,tj->...ti", turn, vectors)
        found[..., at] = carried + (start[..., None, :] if letter == "" else 0.0)
    return found


def _lifted(courses: Array, names: Sequence[str], by: ArrayLike, earth_fixed: bool) -> Array:
    """Return courses (..., time, n) that start higher by (...) [m], along the vertical of their start."""
    at = columns(names, POSITION)
    found = courses.copy()
    vertical = normal(courses[..., 0, at]) if earth_fixed else np.array([0.0, 0.0, 1.0])
    found[..., at] += (np.asarray(by)[..., None] * vertical)[..., None, :]
    return found


def moved_to(frame: Frame, course: Array, names: Sequence[str], centre: Array | None, height: float | None) -> Array:
    """Return a course that starts over or below a place, and at a height.

    Parameters
    ----------
    frame : Frame
    course : ndarray, shape (time, n)
        Of components `names`; it is carried along as a rigid whole.
    names : sequence of str
    centre : ndarray, shape (3,), optional
        [m]
    height : float, optional
        [m]; not in inertial axes.

    Raises
    ------
    UserError
        If the target has no height.
    """
    if (centre is not None or height is not None) and not set(POSITION) <= set(names):
        raise UserError(f"map: a target of {', '.join(names)} cannot be moved; {', '.join(POSITION)} are needed")
    if centre is not None and frame.geodetic:
        place = course[0, columns(names, POSITION)]
        here, there = ecef_to_geodetic(place), ecef_to_geodetic(centre)
        turn = enu_rotation(*there[:2]).T @ enu_rotation(*here[:2])
        course = _carried(course, names, place, geodetic_to_ecef(*there[:2], here[2]), turn)
    elif centre is not None:
        chart = chart_of(frame, course, names)
        course = chart.moved(course, names, chart.coordinates(centre))
    if height is not None and frame.height is not None:
        now = frame.height(course[0, columns(names, POSITION)])
        course = _lifted(course, names, height - now, frame.geodetic)
    return course


def chart_of(
    frame: Frame | str,
    course: Array,
    names: Sequence[str],
    plane: str = "level",
    middle: str = _TARGET,
) -> Chart:
    """Return the plane over which a target may be moved about.

    Parameters
    ----------
    frame : Frame, or its name
    course : ndarray, shape (time, n)
        The target of the scenario.
    names : sequence of str
        Its components.
    plane : {'level', 'east_up', 'north_up'}
        Upright ones in local and Earth-fixed axes only.
    middle : str
        What is in the middle, for the labels.

    Raises
    ------
    UserError
        If the target's place has too few components.
    """
    frame = as_frame(frame)
    needed = POSITION[:2] if frame.flat else POSITION
    if not set(needed) <= set(names):
        raise UserError(f"gdop: a target of {', '.join(names)} cannot be moved about; {', '.join(needed)} are needed")
    if plane != "level":
        if frame.height is None or not set(POSITION) <= set(names):
            raise UserError(f"map: plane {plane} is not allowed in frame {frame.name} of {', '.join(names)}; level")
        return Upright(_level(frame, course, names, middle), course[0, columns(names, POSITION)], plane)
    return _level(frame, course, names, middle)


def _level(frame: Frame, course: Array, names: Sequence[str], middle: str) -> Flat | Shell:
    if frame.flat:
        return Flat(frame.map_names, frame.map_labels, course[0, columns(names, ("y", "x"))])
    place = course[0, columns(names, POSITION)]
    radial = place / np.linalg.norm(place)
    if frame.geodetic:
        across = np.array([0.0, 0.0, 1.0])
    else:
        ahead = course[min(1, len(course) - 1), columns(names, POSITION)] - place
        across = np.cross(place, ahead)
    across = across - radial * (radial @ across)
    across /= np.linalg.norm(across)
    above, beside = frame.map_labels
    labels = above.replace(_TARGET, middle), beside
    return Shell(frame.map_names, labels, place, np.stack([across, np.cross(across, radial)]), frame.geodetic)
