"""A system of a user's own: what its file declares."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path as FilePath

import numpy as np
from numpy.typing import NDArray

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.assembly.late import Late
from quietfix.diagrams.assembly.model import Assumed, Model, Part
from quietfix.diagrams.assembly.recorded import Recorded
from quietfix.diagrams.assembly.source import look_in
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.own.classes import plants
from quietfix.diagrams.own.declaring.apart import check_apart
from quietfix.diagrams.own.declaring.asking import ask_own
from quietfix.diagrams.own.declaring.atmosphere import unaffected
from quietfix.diagrams.own.declaring.beginning import Begin, Surroundings, begin
from quietfix.diagrams.own.declaring.biases import own_biases
from quietfix.diagrams.own.declaring.impairing import Together, impaired
from quietfix.diagrams.own.declaring.resolving import open_cycles, phase_resolvers
from quietfix.diagrams.own.declaring.sensing import (
    NAME,
    Measured,
    PlacedSensor,
    differentiated,
    placed_sensors,
    used_rows,
)
from quietfix.diagrams.own.declaring.target import Target, target_motion, true_motion, with_bias
from quietfix.diagrams.own.fed.arrivals import against_references
from quietfix.diagrams.own.fed.handed import Handed, handed
from quietfix.diagrams.own.fed.late_table import late_table, too_late
from quietfix.diagrams.own.fed.measured import measured, recorded_of, setting_of, table_of_scenario, true_paths
from quietfix.diagrams.own.fed.played import Played
from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.own.fields.view import view_of
from quietfix.diagrams.parts.formation import gravity_constants
from quietfix.diagrams.parts.impairment import KnownPlatforms
from quietfix.diagrams.parts.latency import late_of
from quietfix.diagrams.parts.movers import Platforms
from quietfix.diagrams.parts.sensing import TargetSensor
from quietfix.diagrams.paths.functions import Path, path_of, paths_of
from quietfix.diagrams.paths.movers import Gpx, Mover, Platform, RandomMotion, Tle
from quietfix.diagrams.paths.places import Places
from quietfix.diagrams.paths.receivers import doubtful_heights
from quietfix.diagrams.paths.records import Setting, old_elements
from quietfix.diagrams.paths.tables import doubtful_table
from quietfix.diagrams.readers.measurements import MeasurementTable
from quietfix.diagrams.schema.errors import UserError, shown
from quietfix.diagrams.schema.scenario import read_yaml
from quietfix.systems.clocks import Clock, Merged
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.integration import LONGEST_STEP
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.plants.path import Path as PathBlock

__all__ = ["OwnScenario", "declare", "own_system", "places_of"]

Array = NDArray[np.float64]

_OSCILLATOR = 6  # where its error stands in the state


def _check_seen(scenario: OwnScenario, sensors: Sequence[PlacedSensor], target: Path, platforms: Path) -> None:
    """Refuse a target that nobody ever sees."""
    for one in sensors:
        mask, times = one.mask, one.clock.ticks(scenario.duration_s)
        if mask is None:
            continue
        picked = times[:: max(1, len(times) // 60)]
        states = np.array([target(float(t)) for t in picked])
        carriers = np.array([platforms(float(t)).reshape(-1, 6) for t in picked])
        if not mask.visible(states, carriers).any():
            raise UserError(
                f"sensors.{one.name}.minimum_elevation_deg: {one.field.minimum_elevation_deg:g} is not allowed; no "
                "platform ever sees the target"
            )


def places_of(scenario: OwnScenario) -> Places:
    """Return what sensors have around them."""
    for name in scenario.platforms:
        if not NAME.fullmatch(name):
            raise UserError(f"platforms: the name {name!r} is not allowed; letters, digits and _, a letter first")
    numbers = {name: i for i, name in enumerate(scenario.platforms)}
    constants = gravity_constants(scenario.constants)
    return Places(numbers, scenario.axes, constants, None if scenario.oscillator is None else _OSCILLATOR)


def declare(scenario: OwnScenario, folder: FilePath = FilePath(), live: bool = False, scaled: bool = False) -> Model:
    """Return platforms, target, sensors and what the estimators are given; see `quietfix.diagrams.assembly`.

    Parameters
    ----------
    scenario : OwnScenario
    folder : Path
        What paths in the scenario are relative to.
    live : bool
        Whether measurements are handed over one by one: a part of the model is
        `quietfix.diagrams.own.fed.handed.Handed`.
    scaled : bool
        Whether the noise of rows is handed over with them.
    """
    if not scenario.platforms:
        raise UserError("platforms: none is given; at least one is needed")
    scenario, table = (scenario, None) if live else _with_table(scenario, folder)
    constants, frame = gravity_constants(scenario.constants), scenario.axes
    setting = setting_of(scenario, folder, table)
    paths = paths_of({f"platforms.{name}": one for name, one in scenario.platforms.items()}, frame, setting, constants)
    sensors = placed_sensors(scenario, places_of(scenario))
    flight = target_motion(scenario)
    motion = with_bias(scenario, flight, scenario.belief.walk_hz2ps)

    def carriers(t: float) -> Array:
        return np.concatenate([one(t) for one in paths])

    platforms = Platforms(lambda: PathBlock(carriers, "carriers", 6 * len(paths)))
    truth = _truth(scenario, setting, platforms)
    path = next(iter(truth.values()), None)
    kinds = [kind for one in sensors for kind in one.kinds]
    resolvers = phase_resolvers(scenario, kinds, motion.size)
    fed: Played | Handed | None = None
    if live:
        fed = handed(scenario, setting, kinds, places_of(scenario), truth, _clock(sensors), carriers)
        fed = fed.with_scales() if scaled else fed
    elif table is not None:
        fed = measured(scenario, setting, table, kinds, places_of(scenario), truth, carriers)
    clock = _clock(sensors) if fed is None else fed.clock
    scaled = fed is not None and fed.scaled
    around = Surroundings(scenario, kinds, clock, motion.size, path, carriers, setting, scaled)
    doubt = ask_own(around, flight, simulated=fed is None)
    parts = _simulated(around, sensors, flight, bool(resolvers.each)) if fed is None else [fed]
    start, needed = begin(around)

    def assume(bus: Bus, name: str, options: EstimatorOptions) -> Assumed:
        raw = options.resolves_phases or not resolvers.each
        seen = list(resolvers.rows) if raw else resolvers.on(bus)
        takes = {"measurement": "raw"} if raw and resolvers.each else {}
        takes |= dict.fromkeys(("noise_covariance", "start_noise_covariance"), "noise_covariance") if scaled else {}
        rows, clearings = used_rows(sensors, options, name), () if raw else resolvers.clearings
        return Assumed(rows, motion, start(name, options, seen), seen, takes, clearings=clearings)

    notes = [differentiated(sensors, flight), doubt, _open(around, start), _doubtful(scenario, setting, kinds)]
    return Model(
        clock=clock,
        duration=fed.end if isinstance(fed, Played) else scenario.duration_s,
        divergence=scenario.divergence_m,
        parts=_with_own(scenario, [platforms, *parts[:1]], [*parts[1:], *needed]),
        assume=assume,
        truth_motion=true_motion(scenario, flight),
        truth_states=motion.names if fed is None else motion.names[:6],
        platforms=list(scenario.platforms),
        frame=frame,
        signals={**resolvers.signals, **{k: v for field in scenario.parts for k, v in field.signals.items()}},
        rows=resolvers.rows,
        step=scenario.target.step_s if isinstance(scenario.target, plants.Custom) else LONGEST_STEP,
        recorded=_recorded(fed, bool(truth), setting),
        late=_late(scenario, sensors, fed, resolvers.rows),
        view=view_of(scenario.map, frame, setting, constants),
        biases=own_biases(scenario, sensors),
        note=" ".join(note for note in (*notes, *_said(scenario, fed)) if note),
    )


def _said(scenario: OwnScenario, fed: Played | Handed | None) -> list[str]:
    """Return what is to be said of measurements."""
    late = too_late(fed, scenario.belief.late) if isinstance(fed, Played) else []
    return [*(fed.notes if fed else ()), *late]


def _with_table(scenario: OwnScenario, folder: FilePath) -> tuple[OwnScenario, MeasurementTable | None]:
    """Return the table of measurements of a scenario, if it has one, and the scenario that reads it."""
    table = table_of_scenario(scenario, folder)
    return (scenario, None) if table is None else against_references(scenario, table)


def _recorded(fed: Played | Handed | None, known: bool, setting: Setting) -> Recorded | None:
    """Return what makes it a recording; None: it is simulated."""
    if isinstance(fed, Played):
        return recorded_of(fed, known, setting.began())
    return None if fed is None else fed.recorded


def _late(
    scenario: OwnScenario, sensors: Sequence[PlacedSensor], fed: Played | Handed | None, stream: Sequence[str]
) -> Late | None:
    """Return which measurements are late: of a file those that are older than one before them, if it is asked for."""
    if fed is not None:
        return late_table(fed, scenario.belief.late, stream) if isinstance(fed, Played) else None
    rows = {one.name: [row for model in one.models for row in model.names] for one in sensors}
    fields = {f"sensors.{one.name}.latency_s": (rows[one.name], one.field.latency_s) for one in sensors}
    return late_of(fields, scenario.belief.late, [row for own in rows.values() for row in own])


def _clock(sensors: Sequence[PlacedSensor]) -> Clock:
    """Return when anything is measured in a simulation."""
    return sensors[0].clock if len(sensors) == 1 else Merged([one.clock for one in sensors])


def _simulated(
    around: Surroundings, sensors: Sequence[PlacedSensor], flight: MotionModel, resolved: bool
) -> list[Part]:
    """Return target and sensors of a simulation, checked; `resolved`: whether something resolves phases."""
    scenario, path = around.scenario, around.target
    assert path is not None
    _check_seen(scenario, sensors, path, around.carriers)
    check_apart(scenario, sensors, path, around.carriers)
    return [Target(scenario, flight, path, around.clock), *_sensing(scenario, sensors, resolved)]


def _open(around: Surroundings, start: Begin) -> str:
    """Return what the start does not tell of the phases."""
    if around.target is None:
        return ""
    rows = [row for kind in around.kinds for row in kind.real.names]
    for name, options in around.scenario.estimators.items():
        if not options.resolves_phases:
            target = np.zeros((1, around.states))
            target[0, :6], platforms = around.target(0.0), around.carriers(0.0).reshape(1, -1, 6)
            spread = start(name, options, rows).covariance_at(target, platforms)
            return open_cycles(around.kinds, spread, target, platforms)
    return ""


def _with_own(scenario: OwnScenario, before: Sequence[Part], sensing: Sequence[Part]) -> list[Part]:
    """Return all parts, with a user's own before the sensors and before the estimators."""
    found: dict[str, list[Part]] = {"sensors": [], "estimators": []}
    for i, field in enumerate(scenario.parts):
        found[field.before].append(field.part(f"parts.{i}"))
    return [*before, *found["sensors"], *sensing, *found["estimators"]]


def _sensing(scenario: OwnScenario, sensors: Sequence[PlacedSensor], resolved: bool) -> list[Part]:
    """Return the parts that measure; `resolved`: whether phases are resolved before the estimators get them."""
    parts: list[Part] = []
    for one in sensors:
        parts += [
            TargetSensor(one.name, one.real, one.clock, one.mask),
            impaired(one, scenario.axes, list(scenario.platforms)),
        ]
    parts.append(Together([one.name for one in sensors], ["raw", "measurement"] if resolved else ["measurement"]))
    errors = scenario.platform_errors
    return [*parts, KnownPlatforms(errors.sigma_position_m, errors.sigma_velocity_mps)]


def _truth(scenario: OwnScenario, setting: Setting, platforms: Part) -> dict[str, Path]:
    """Return the state (6,) of the target, or the mean of its start, as a function of time.

    Of measurements by the names of targets, and nothing where nobody knows.
    """
    target, constants = scenario.target, gravity_constants(scenario.constants)
    if scenario.measurements is not None:
        return true_paths(scenario, setting)
    if target is None:
        raise UserError("target: none is given; one is needed, or measurements")
    if isinstance(target, plants.Custom):
        return {"": plants.played(target, platforms)}
    return {"": path_of(_mover(target), scenario.axes, setting, constants, "target")}


def _mover(target: Mover | RandomMotion) -> Mover:
    return target.start if isinstance(target, RandomMotion) else target


def _doubtful(scenario: OwnScenario, setting: Setting, kinds: Sequence[Measured]) -> str:
    """Return which two-line elements are old, which tables of platforms may be cut, which heights are above what."""
    movers = {f"platforms.{name}": one for name, one in scenario.platforms.items()}
    if scenario.target is not None and not isinstance(scenario.target, plants.Custom):
        movers["target"] = _mover(scenario.target)
    notes = [old_elements(one, setting, where) for where, one in movers.items() if isinstance(one, Tle)]
    notes += [doubtful_table(one, setting, where) for where, one in movers.items() if isinstance(one, Platform)]
    notes += [doubtful_heights(one, setting, where) for where, one in movers.items() if isinstance(one, Gpx)]
    notes.append(unaffected(scenario, {kind.name: (kind.field, kind.real) for kind in kinds}))
    return " ".join(dict.fromkeys(note for note in notes if note))


def own_system(path: FilePath, text: str | None = None) -> System:
    """Return the system that a YAML file of a user's declares.

    Parameters
    ----------
    path : Path
        The file; what it says are the values of its scenario, and other files are relative to it. A user's own classes
        are looked for beside it, too.
    text : str, optional
        What is in the file, where a result says it; nothing is looked for beside the file then.

    Raises
    ------
    UserError
        If the file is none, or empty.
    """
    folder = path.resolve().parent
    if text is None:
        look_in(folder)
    base = read_yaml(path, "system") if text is None else read_yaml(text)
    if not base:
        raise UserError(f"system: {shown(path)} is empty; platforms, a target, sensors and estimators are needed")
    return System(
        name=re.sub(r"[^\w+-]|^_+", "-", path.stem).strip("-")[:60] or "own",
        title=f"declared in {path.name}",
        scenario=OwnScenario,
        declare=partial(declare, folder=folder),
        base=base,
        file=path,
    )
