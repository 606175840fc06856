"""The maps of a model that offers none: its target moved about on the frame's plane, all else as the diagram has it.

The course of trial 0 and the platforms come from a run. The map is a square around the target's start that reaches a
tenth beyond the furthest of the platforms and of the course, along the two axes; on a shell around the Earth half a
radian at most. What is measured, how the target moves and what is known of it before are what each estimator believes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import DiagramBuilder

from quietfix.diagrams.assembly.build import Assembly, build
from quietfix.diagrams.assembly.map import BoundMap, Plane, View
from quietfix.diagrams.assembly.model import Model
from quietfix.diagrams.maps.charts import chart_of, moved_to
from quietfix.diagrams.maps.sides import sides_of
from quietfix.diagrams.quantities.states import POSITION, VELOCITY, columns, shared, translated
from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.bounds import alike, rows_present
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.integration import simulator_of
from quietfix.systems.recorder import record
from quietfix.systems.sensors.sensor import Sensor
from quietfix.systems.signals import Draw, set_draw

__all__ = ["default_maps", "recorded_course"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_KM = 1e3
_TARGET = "the scenario's target"
_CLOSEST = 1e-3  # of half a side; a target that comes nearer to a platform is not mapped
_ALIKE = 0.01  # relative difference of standard deviations that count as one
_CURVES = 20  # paths of platforms drawn
_MAPPED = ("position", "height", "velocity")


def default_maps(model: Model, options: Mapping[str, Any], points: int | None = None) -> list[BoundMap]:
    """Return the maps of a model that offers none: one for each set of sensor, motion and start of the estimators.

    Parameters
    ----------
    model : Model
    options : mapping of str to EstimatorOptions
        Its estimators.
    points : int, optional
        Along a side; by default 31, fewer where a run has many epochs.

    Raises
    ------
    UserError
        If the target has no plane to be moved on, or of no estimator's start can be said what it knows.
    """
    builder = DiagramBuilder()
    assembly = build(model, builder, options, 1)
    sensors = [block for block in builder.GetSystems() if isinstance(block, Sensor)]
    names, frame = assembly.truth_names, model.axes
    times, course, platforms = recorded_course(model)
    view, at = model.view or View(), columns(names, shared(POSITION, names))
    start, course = course[0, at], moved_to(frame, course, names, view.centre, view.height)
    chart = chart_of(frame, course, names, view.plane, _TARGET if view.centre is None else "the centre of the map")
    sides = sides_of(chart, view, course[:, at], platforms[0], points, course.size)
    truth = chart.moved(course, names, np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1))
    place = truth[..., at]
    kept = _nearest(place, platforms) > _CLOSEST * np.ptp(sides[1]) / 2
    whole, masked = _rows(sensors, times, place[kept], platforms)
    found = []
    for members, block, prior, spent in _sets(assembly, truth[kept], platforms):
        present = rows_present(assembly, block, _stream(assembly, block, whole, kept.sum(), times.size))
        heard = present.any(axis=(-1, -2))
        seen = np.zeros_like(kept)
        seen[kept] = heard
        own, judged = translated(truth[kept][heard], names, block.motion), shared(block.motion.names, names)
        found.append(
            BoundMap(
                plane=Plane(chart.names, chart.labels, (sides[0] / _KM, sides[1] / _KM)),
                seen=seen,
                truth=own,
                platforms=platforms,
                times=times,
                sets={members[0]: block.bound_model},
                motion=block.motion,
                prior=prior if prior.ndim == 2 or len(prior) == 1 else prior[heard],
                stated=_stated(members, block, own[:1, 0], times, prior, masked, view),
                track=chart.coordinates(platforms[0, :, :_CURVES, :3]) / _KM,
                track_labels=("platforms",) * min(platforms.shape[2], _CURVES),
                track_names=assembly.platform_names[:_CURVES],
                points=chart.coordinates(start)[None] / _KM,
                points_label=f"{_TARGET} at the start",
                first_epoch_used=spent,
                present=None if present.all() else present[heard],
                quantities=tuple(what for what in _MAPPED if what in frame.quantities(judged)),
                frame=frame,
                equal=view.plane == "level",
                judged=judged,
            )
        )
    return found


def recorded_course(model: Model, seed: int = 0) -> tuple[Array, Array, Array]:
    """Return times (time,), truth (time, n) and platforms (1, time, p, 6) of trial 0; no estimator is run."""
    builder = DiagramBuilder()
    alone = build(model, builder, {}, 1)
    recorder = record(builder, {"truth": alone.truth, "platforms": alone.platforms}, alone.clock)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    set_draw(diagram, context, Draw(seed, 0))
    simulator = simulator_of(diagram, context, model.step)
    simulator.Initialize()
    # rounding may put the last tick a bit after the end
    simulator.AdvanceTo(max(alone.duration, *alone.clock.ticks(alone.duration)[-1:]))
    times, signals = recorder.result(context)
    return times, signals["truth"][:, 0], signals["platforms"][:, 0].reshape(1, times.size, -1, 6)


def _nearest(place: Array, platforms: Array) -> Array:
    """Return how near any platform ever comes to targets (k, l, time, axes) [m], shape (k, l)."""
    axes, near = place.shape[-1], np.full(place.shape[:-2], np.inf)
    for i in range(platforms.shape[2]):
        near = np.fmin(near, np.linalg.norm(place - platforms[0, :, i, :axes], axis=-1).min(axis=-1))
    return near


# ------------------------------------------------------------------------------------------------ what is measured


def _rows(sensors: Sequence[Sensor], times: Array, place: Array, platforms: Array) -> tuple[dict[str, Mask], str]:
    """Return which rows of the sensors are measured, by name, each (points or 1, time), and in words."""
    found: dict[str, Mask] = {}
    masked = False
    for sensor in sensors:
        ticking = np.array([sensor.clock.index(float(t)) is not None for t in times])
        seen = sensor.visible_rows(place, platforms)
        masked |= seen is not None
        for i, row in enumerate(sensor.model.names):
            found[row] = ticking[None] if seen is None else ticking & seen[..., i]
    return found, "rows where the sensors see it" if masked else "all rows measured everywhere"


def _stream(assembly: Assembly, block: Estimator, rows: Mapping[str, Mask], points: int, epochs: int) -> Mask:
    """Return which rows of a measurement stream are measured (points, time, rows); those of no sensor always are."""
    stream = list(assembly.stream or block.wiring.stream)
    return np.stack([np.broadcast_to(rows.get(row, np.True_), (points, epochs)) for row in stream], axis=-1)


def _sets(assembly: Assembly, truth: Array, platforms: Array) -> list[tuple[list[str], Estimator, Array, bool]]:
    """Return estimators that share sensor, motion and start; one of them, its prior, and whether epoch 0 is spent."""
    found: list[tuple[list[str], Estimator, Array, bool]] = []
    for name, block in assembly.estimators.items():
        first = translated(truth[:, 0], assembly.truth_names, block.motion)
        prior, spent = block.bound_prior(first, platforms[:, 0])
        if prior is None or prior.shape[-1] != block.motion.size:
            continue
        for members, other, known, used in found:
            if alike((block.bound_model, block.motion, prior, spent), (other.bound_model, other.motion, known, used)):
                members.append(name)
                break
        else:
            found.append(([name], block, prior, spent))
    if not found:
        raise UserError("gdop: of no estimator's start can be said what it knows, so that there is no bound")
    return found


# -------------------------------------------------------------------------------------------------- in words


def _stated(
    members: Sequence[str], block: Estimator, state: Array, times: Array, prior: Array, rows: str, view: View
) -> dict[str, str]:
    height = "" if view.height is None or view.plane != "level" else f" at a height of {view.height:g} m"
    believe = "believes" if len(members) == 1 else "believe"
    return {
        "noise": _noise(block, state, times),
        "prior": _prior(block, prior),
        "target": f"the scenario's course{height}, moved about as a whole; {rows}; as {_few(members)} {believe}",
    }


def _few(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) < 4 else f"{names[0]} and {len(names) - 1} others"


def _prior(block: Estimator, prior: Array) -> str:
    """Return the standard deviations of a start, their median over the map where they differ."""
    each = prior if prior.ndim == 3 else prior[None]
    words = _sigmas(block, np.median(np.diagonal(each, axis1=-2, axis2=-1), axis=0))
    return words if len(each) == 1 else f"{words} (median over the map)"


def _noise(block: Estimator, state: Array, times: Array) -> str:
    """Return the process noise of the first step, at the state (1, n) of one of the targets."""
    if times.size < 2 or not len(state):
        return "none"
    step = float(times[1] - times[0])
    variance = np.diagonal(block.motion.process_noise(state, step), axis1=-2, axis2=-1)
    flat = np.reshape(variance, (-1, block.motion.size))[0]
    return f"{_sigmas(block, flat)} in {step:g} s" if np.any(flat > 0) else "none"


def _sigmas(block: Estimator, variance: Array) -> str:
    """Return standard deviations in words; those of alike axes once."""
    names, units, sigmas = list(block.motion.names), list(block.motion.units), np.sqrt(variance)
    words = []
    for group in (POSITION, VELOCITY):
        at = [names.index(name) for name in shared(group, names)]
        if at and np.ptp(sigmas[at]) < _ALIKE * sigmas[at].max():
            words.append(f"{sigmas[at].max():.4g} {units[at[0]]} per axis")
        elif at:
            words.append(", ".join(f"{names[i]} {sigmas[i]:.4g}" for i in at) + f" {units[at[0]]}")
    rest = [name for name in names if name not in (*POSITION, *VELOCITY)]
    return ", ".join([*words, *(f"{name} {sigmas[names.index(name)]:.4g} {units[names.index(name)]}" for name in rest)])
