"""A stage in Drake's Meshcat, with its recording."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Box, Meshcat, MeshcatParams, Rgba, Sphere
from pydrake.math import RigidTransform, RotationMatrix

from quietfix.diagrams.scenes.ground import COASTS
from quietfix.diagrams.scenes.stage import SIZE, Moving, Stage
from quietfix.diagrams.scenes.timing import Timing
from quietfix.diagrams.schema.errors import UserError

__all__ = ["opened", "perform"]

Array = NDArray[np.float64]

_SEA, _NET, _COAST = (0.72, 0.83, 0.92), (0.5, 0.63, 0.73), (0.2, 0.3, 0.2)
_CAMERA = "/Cameras/default/rotated/<object>"
_LIGHTS = {
    "SpotLight": 0.0,
    "PointLightNegativeX": 0.0,
    "PointLightPositiveX": 0.0,
    "AmbientLight": 2.2,
    "FillLight": 1.0,
}
_VIEW = SIZE * np.array([0.55, -1.0, 0.6])  # where the camera is
_FARTHEST = 2000.0  # units: the other side of the Earth, of a small scene
_LIFTED = 3e-4  # of the radius: lines above the triangles


def opened() -> Meshcat:
    """Return a Meshcat on this machine alone.

    Raises
    ------
    UserError
        If it can listen at no address.
    """
    logging.getLogger("drake").setLevel(logging.WARNING)  # the address is printed in this program's words
    try:
        return Meshcat(MeshcatParams(host="localhost", show_stats_plot=False))
    except RuntimeError as error:
        raise UserError(f"play: Meshcat cannot listen on this machine ({error})") from error


def perform(stage: Stage, meshcat: Meshcat, timing: Timing) -> None:
    """Draw a stage, record what moves, and publish the recording.

    Parameters
    ----------
    stage : Stage
    meshcat : Meshcat
    timing : Timing
        When in the recording each epoch is.
    """
    for unwanted in ("/Grid", "/Axes"):
        meshcat.SetProperty(unwanted, "visible", False)
    for end in ("top_color", "bottom_color"):
        meshcat.SetProperty("/Background/<object>", end, [0.97, 0.97, 0.98])
    for name, intensity in _LIGHTS.items():
        meshcat.SetProperty(f"/Lights/{name}/<object>", "intensity", intensity)
    meshcat.SetProperty(_CAMERA, "far", _FARTHEST)
    meshcat.SetCameraPose(_VIEW, np.zeros(3))
    _draw_ground(stage, meshcat)
    for line in stage.paths:
        for number, places in enumerate(_pieces(line.places)):
            meshcat.SetLine(f"{line.path}/{number}", np.asfortranarray(places.T), 2.0, Rgba(*line.colour, 1.0))
    for thing in stage.moving:
        _draw(thing, meshcat)
    meshcat.StartRecording(timing.frames_per_second, set_visualizations_while_recording=False)
    for thing in stage.moving:
        _record(thing, meshcat, timing)
    if stage.turns is not None:
        for turn, at in zip(stage.turns, timing.seconds, strict=True):
            meshcat.SetTransform("earth", RigidTransform(RotationMatrix(turn)), at)
    meshcat.StopRecording()
    meshcat.PublishRecording()


def _pieces(places: Array) -> list[Array]:
    """Return what of a line is there, in pieces of at least two places."""
    known = np.isfinite(places).all(axis=-1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], known, [False]]).astype(int)))
    return [places[a:b] for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a > 1]


def _draw_ground(stage: Stage, meshcat: Meshcat) -> None:
    lifted = 1.0 if stage.earth is None else 1 + _LIFTED
    if stage.earth is not None:
        vertices, faces = stage.placed(stage.earth.vertices), stage.earth.faces
        meshcat.SetTriangleMesh(
            "earth/surface", np.asfortranarray(vertices.T), np.asfortranarray(faces.T), Rgba(*_SEA, 1.0)
        )
    for i, net in enumerate(stage.nets):
        ends = [np.asfortranarray(stage.placed(lifted * places).T) for places in (net.starts, net.ends)]
        coast = net.name == COASTS
        colour, width = (_COAST, 2.0) if coast else (_NET, 1.0)
        meshcat.SetLineSegments("earth/coasts" if coast else f"earth/lines_{i}", *ends, width, Rgba(*colour, 1.0))


def _draw(thing: Moving, meshcat: Meshcat) -> None:
    """Draw a thing; its size is at the leaf, so that its pose is above that."""
    rgba, leaf = Rgba(*thing.colour, thing.opacity), f"{thing.path}/shape"
    if thing.shape == "segment":
        ends = [np.array([[0.0, 0.0, z]]).T for z in (0.0, 1.0)]
        meshcat.SetLineSegments(leaf, *(np.asfortranarray(end) for end in ends), 1.0, rgba)
    else:
        meshcat.SetObject(leaf, Box(2, 2, 2) if thing.shape == "box" else Sphere(1), rgba)
    if thing.sizes.ndim == 1:
        meshcat.SetProperty(leaf, "scale", [float(size) for size in thing.sizes])


def _record(thing: Moving, meshcat: Meshcat, timing: Timing) -> None:
    """Record poses and sizes where it is to be seen, and where it is not."""
    seen = np.asarray(np.isfinite(thing.places).all(axis=-1))
    still = thing.turns is None and bool(seen.all()) and float(np.ptp(thing.places, axis=0).max()) < 1e-9
    for k in np.flatnonzero(seen):
        turn = RotationMatrix() if thing.turns is None else RotationMatrix(thing.turns[k])
        pose = RigidTransform(turn, thing.places[k])
        if still:
            meshcat.SetTransform(thing.path, pose)
            return
        meshcat.SetTransform(thing.path, pose, timing.seconds[k])
        if thing.sizes.ndim == 2:
            meshcat.SetProperty(f"{thing.path}/shape", "scale", [float(s) for s in thing.sizes[k]], timing.seconds[k])
    if not seen.all():
        changes = np.flatnonzero(np.r_[True, seen[1:] != seen[:-1]])
        for k in changes:
            meshcat.SetProperty(thing.path, "visible", bool(seen[k]), timing.seconds[k])
