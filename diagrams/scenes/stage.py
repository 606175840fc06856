"""Scenes put on a stage: things with poses over time, in units that suit a camera, z up."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.pages.coast import COAST_NOTE
from quietfix.diagrams.scenes.ground import Mesh, Segments, blocked, coasts, earth, graticules, grid
from quietfix.diagrams.scenes.scene import Estimated, Scene, Track
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.constants import EARTH_RATE
from quietfix.systems.earth.geodetic import ecef_to_geodetic, enu_rotation

__all__ = [
    "COLOURS",
    "PLATFORM",
    "SIGHT",
    "SIZE",
    "TARGET",
    "Colour",
    "Moving",
    "Path",
    "Stage",
    "staged",
    "step_below",
]

Array = NDArray[np.float64]
Colour = tuple[float, float, float]

SIZE = 10.0
"""Units from the middle of a stage to what is farthest from it."""
_MARK = SIZE / 100  # half the size of a platform
_SEEN = SIZE / 40  # as large as the median error is drawn
_ASIDE = SIZE / 4  # an estimate that is drawn further off its target leaves no line across the scene
_FLAT = 0.01  # of the longest semi-axis: how thin an ellipsoid is drawn at least, for the lamp's sake
# Okabe and Ito, *Color universal design* (2008)
COLOURS: tuple[Colour, ...] = (
    (0.0, 0.447, 0.698),
    (0.0, 0.62, 0.451),
    (0.8, 0.475, 0.655),
    (0.902, 0.624, 0.0),
    (0.337, 0.706, 0.914),
)
TARGET: Colour = (0.835, 0.369, 0.0)
PLATFORM: Colour = (0.15, 0.15, 0.15)
SIGHT: Colour = (0.45, 0.45, 0.45)


@dataclass(frozen=True, eq=False)
class Moving:
    """A thing that moves on the stage.

    Attributes
    ----------
    path : str
        In Meshcat's tree.
    shape : str
        ``sphere`` of radius 1, ``box`` of half-width 1 or ``segment`` from the origin to z = 1.
    colour : (red, green, blue)
    opacity : float
    places : ndarray, shape (epochs, 3)
        NaN where it is not to be seen.
    sizes : ndarray, shape (3,) or (epochs, 3)
        Factors along the axes of the shape.
    turns : ndarray or None, shape (epochs, 3, 3)
        Rotations.
    """

    path: str
    shape: str
    colour: Colour
    opacity: float
    places: Array
    sizes: Array
    turns: Array | None = None


@dataclass(frozen=True, eq=False)
class Path:
    """A line through places (n, 3) that does not move, in Meshcat's tree at `path`."""

    path: str
    colour: Colour
    places: Array


@dataclass(eq=False)
class Stage:
    """All that is drawn.

    Attributes
    ----------
    unit : float
        Metres that one unit stands for.
    magnified : float
        How many times as large errors and ellipsoids are drawn.
    origin, axes : ndarray, shapes (3,) and (3, 3)
        The place of the frame that is in the middle, and the rotation from the axes of the frame to those of the stage.
    times : ndarray, shape (epochs,)
        Of all that moves [s].
    moving, paths, nets : lists of Moving, Path and Segments
    earth : Mesh or None
    turns : ndarray or None, shape (epochs, 3, 3)
        Of Earth and nets, where they turn in the frame.
    legend : list of (str, colour)
    notes : list of str
        On scales and ground.
    """

    unit: float
    magnified: float
    origin: Array
    axes: Array
    times: Array
    moving: list[Moving] = field(default_factory=list)
    paths: list[Path] = field(default_factory=list)
    nets: list[Segments] = field(default_factory=list)
    earth: Mesh | None = None
    turns: Array | None = None
    legend: list[tuple[str, Colour]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    @property
    def scale(self) -> str:
        """Return how large errors are drawn, in words."""
        larger = f"drawn {self.magnified:g} times as large" if self.magnified != 1 else "true to scale"
        return f"errors and ellipsoids are {larger}"

    def placed(self, places: Array) -> Array:
        """Return places of the frame (..., 3) [m] in units of the stage."""
        return np.asarray((places - self.origin) @ self.axes.T / self.unit)

    def stretched(self, differences: Array) -> Array:
        """Return differences of places (..., 3) [m], magnified, in units of the stage."""
        return np.asarray(differences @ self.axes.T * (self.magnified / self.unit))


def staged(scene: Scene, magnify: float | None = None) -> Stage:
    """Return a scene on its stage.

    Parameters
    ----------
    scene : Scene
    magnify : float, optional
        How many times as large errors and ellipsoids are drawn. By default 1, 2 or 5 times a power of ten, so that the
        median error over trials and epochs is at most a fortieth of the scene, and not below 1.

    Raises
    ------
    UserError
        If there are more estimators than colours that can be told apart.
    """
    if len(scene.estimates) > len(COLOURS):
        raise UserError(f"--estimator: {len(scene.estimates)} of them are not allowed; at most {len(COLOURS)}")
    origin, axes = _middle(scene)
    tracks = [scene.target.places, *(track.places for track in scene.platforms)]
    far = max(1.0, *(float(np.nanmax(np.linalg.norm(places - origin, axis=-1))) for places in tracks))
    unit = far / SIZE
    stage = Stage(unit, _magnified(scene, unit) if magnify is None else magnify, origin, axes, scene.times)
    for track in (*scene.platforms, scene.target):
        _track(stage, track)
    for place, one in enumerate(scene.estimates):
        _estimate(stage, scene, one, COLOURS[place % len(COLOURS)])
    for track in scene.platforms:
        _sight(stage, scene, track)
    if scene.platforms:
        stage.legend.append(("line of sight", SIGHT))
    _ground(stage, scene, far)
    return stage


def _geocentric(scene: Scene) -> bool:
    return scene.frame.name in ("earth_fixed", "inertial")


def _middle(scene: Scene) -> tuple[Array, Array]:
    """Return the place in the middle of the stage, and the rotation to its axes."""
    target = scene.target.places[np.isfinite(scene.target.places).all(axis=-1)]
    middle = target[len(target) // 2]
    if scene.frame.name == "earth_fixed":
        latitude, longitude, _ = ecef_to_geodetic(middle)
        return middle, np.asarray(enu_rotation(latitude, longitude))
    if scene.frame.name == "inertial":
        return np.zeros(3), np.eye(3)
    if scene.frame.name == "launch":  # x down-range, y up, z to the right
        return middle, np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    return middle, np.eye(3)


def step_below(value: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is not above a positive value."""
    power = 10.0 ** math.floor(math.log10(value) + 1e-9)
    return next(factor * power for factor in (5.0, 2.0, 1.0) if factor * power <= value * (1 + 1e-9))


def _magnified(scene: Scene, unit: float) -> float:
    sizes = [np.linalg.norm(e, axis=-1).ravel() for one in scene.estimates for e in (one.errors, one.cloud)]
    known = np.concatenate(sizes)
    known = known[np.isfinite(known) & (known > 0)]
    if not scene.known or not len(known):
        return 1.0
    return step_below(max(1.0, _SEEN * unit / float(np.median(known))))


def _track(stage: Stage, track: Track) -> None:
    """Put on the stage what is known to be somewhere, and where it goes."""
    target = track.kind == "target"
    colour, size = (TARGET, 1.2 * _MARK) if target else (PLATFORM, _MARK)
    places, path = stage.placed(track.places), f"{track.kind}s/{_word(track.name)}"
    shape = "box" if track.kind == "station" else "sphere"
    stage.moving.append(Moving(f"{path}/mark", shape, colour, 1.0, places, np.full(3, size)))
    if track.kind != "station":
        stage.paths.append(Path(f"{path}/path", colour, places))
    told = {"target": "target", "station": "stations (boxes)", "platform": "platforms"}[track.kind]
    if (told, colour) not in stage.legend:
        stage.legend.append((told, colour))


def _estimate(stage: Stage, scene: Scene, one: Estimated, colour: Colour) -> None:
    """Put on the stage what an estimator says: of the shown trial, and of the others around the same truth."""
    truth, path = stage.placed(scene.target.places), f"estimates/{_word(one.name)}"
    places = truth + stage.stretched(one.errors)
    stage.moving.append(Moving(f"{path}/mark", "sphere", colour, 1.0, places, np.full(3, 0.8 * _MARK)))
    stretched = np.linalg.norm(stage.stretched(one.errors), axis=-1, keepdims=True)
    stage.paths.append(Path(f"{path}/path", colour, np.where(stretched < _ASIDE, places, np.nan)))
    for number, errors in zip(one.cloud_trials, one.cloud, strict=True):
        dot = Moving(
            f"{path}/others/{number}", "sphere", colour, 0.5, truth + stage.stretched(errors), np.full(3, 0.4 * _MARK)
        )
        stage.moving.append(dot)
    told = f"{one.name}, trial {scene.trial}"
    if one.axes is not None and one.lengths is not None:
        lengths = one.lengths * (stage.magnified / stage.unit)
        seen = np.where(np.isfinite(lengths).all(axis=-1, keepdims=True), places, np.nan)
        sizes = np.maximum(lengths, _FLAT * lengths.max(axis=-1, keepdims=True))
        stage.moving.append(Moving(f"{path}/ellipsoid", "sphere", colour, 0.3, seen, sizes, stage.axes @ one.axes))
        told += " with its ellipsoid"
    stage.legend.append((told + (f"; dots: {len(one.cloud)} other trials" if len(one.cloud) else ""), colour))


def _sight(stage: Stage, scene: Scene, track: Track) -> None:
    """Put a line on the stage from a platform to the target, where the Earth is not between them."""
    start, end = stage.placed(track.places), stage.placed(scene.target.places)
    along = end - start
    length = np.linalg.norm(along, axis=-1)
    hidden = ~(length > 0)
    if _geocentric(scene):
        hidden |= blocked(track.places, scene.target.places)
    start = np.where(hidden[:, None], np.nan, start)
    sizes = np.stack([np.ones_like(length), np.ones_like(length), length], axis=-1)
    path = f"lines_of_sight/{_word(track.name)}"
    stage.moving.append(Moving(path, "segment", SIGHT, 1.0, start, sizes, _pointing(along)))


def _pointing(along: Array) -> Array:
    """Return rotations (n, 3, 3) that turn z into directions (n, 3); any about it."""
    norm = np.linalg.norm(along, axis=-1, keepdims=True)
    z = np.where(norm > 0, along / np.where(norm > 0, norm, 1.0), [0.0, 0.0, 1.0])
    aside = np.eye(3)[np.argmin(np.abs(z), axis=-1)]
    x = np.cross(aside, z)
    x /= np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=-1)


def _ground(stage: Stage, scene: Scene, far: float) -> None:
    if not _geocentric(scene):
        step = step_below(far / 5)
        stage.nets.append(grid(stage.origin, stage.axes, step, far))
        stage.notes.append(f"grid: squares of {step / 1e3:g} km at height 0")
        return
    inertial = scene.frame.name == "inertial"
    around = np.array([1.0, 0.0, 0.0]) * far if inertial else stage.origin
    stage.earth = earth(around)
    stage.nets.extend(graticules(around, far))
    if inertial:
        angle = EARTH_RATE * scene.times
        c, s, zero = np.cos(angle), np.sin(angle), np.zeros_like(angle)
        rows = [[c, -s, zero], [s, c, zero], [zero, zero, zero + 1]]
        stage.turns = np.moveaxis(np.array(rows), -1, 0)
        stage.notes.append("the Earth turns in these axes; its zero meridian is on x at time 0")
    stage.notes.append(f"Earth: WGS-84, graticule {', '.join(net.name for net in stage.nets)}; {COAST_NOTE}")
    stage.nets.append(coasts())


def _word(name: str) -> str:
    """Return a name as one step of a path."""
    return name.replace("/", "_")
