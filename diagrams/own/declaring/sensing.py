"""Sensors of a system of one's own, placed: with their models as they are and as they are believed to be."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, cast

from quietfix.diagrams.own.declaring.along_track import check_along_track, seen_ahead
from quietfix.diagrams.own.declaring.atmosphere import Air, air_of
from quietfix.diagrams.own.fields.schema import OwnScenario
from quietfix.diagrams.own.fields.sensors import Joint, Kind, Sensor
from quietfix.diagrams.own.kinds.kind import Row
from quietfix.diagrams.own.kinds.phase import Phase
from quietfix.diagrams.paths.places import Places, Timed
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.systems.angles.phase import InterferometerPhase
from quietfix.systems.clocks import Periodic
from quietfix.systems.estimators.options import EstimatorOptions
from quietfix.systems.geometry.visibility import ElevationMask
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.chosen import only
from quietfix.systems.measurement.custom import CustomMeasurement
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.motion.custom import CustomMotion

__all__ = ["NAME", "Measured", "PlacedSensor", "differentiated", "placed_sensors", "used_rows"]

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
"""What a platform or a sensor may be called: rows and blocks are named after them."""

_TAKEN = {
    "assumed_height",
    "carriers",
    "course",
    "flight",
    "initial_estimate",
    "known",
    "measured",
    "measurement",
    "measurements",
    "oscillator",
    "plant",
    "phase_resolver",
    "platform_error",
    "platforms",
    "prediction",
    "prediction_covariance",
    "prior",
    "raw",
    "recorder",
    "target",
    "truth",
}
_BEGINS = ("score_",)
_ENDS = ("_raw", "_reading_error", "_attitude_error")


@dataclass(frozen=True)
class Measured:
    """One kind of measurement: a sensor of its own, or one of the kinds of a joint one.

    Attributes
    ----------
    name : str
        What estimators choose it by.
    where : str
        Its field, for messages.
    field : Kind
    timed : Timed
        When it is measured, and what hides the target.
    real : MeasurementModel
        As it is.
    believed : MeasurementModel
        As estimators believe it to be.
    rows : sequence of Row
        What is measured, as a table names it: of the model, and of the links one after the other.
    links : sequence of InterferometerPhase
        Shorter baselines that resolve its phases.
    """

    name: str
    where: str
    field: Kind
    timed: Timed
    real: MeasurementModel
    believed: MeasurementModel
    rows: Sequence[Row]
    links: Sequence[InterferometerPhase] = ()

    @property
    def clock(self) -> Periodic:
        """When it is measured."""
        return Periodic(self.timed.every_s, self.timed.offset_s)

    @property
    def mask(self) -> ElevationMask | None:
        """What hides the target; None: nothing."""
        elevation = self.timed.minimum_elevation_deg
        return None if elevation is None else ElevationMask(math.radians(elevation), cast(Any, self.timed.elevation_at))

    @property
    def resolved(self) -> bool:
        """Whether its wrapped phases are made unambiguous before the estimators get them."""
        return isinstance(self.field, Phase) and bool(self.field.resolved_by or self.field.chain_m)

    @property
    def cleared(self) -> MeasurementModel:
        """As estimators believe it to be once its phases are resolved, if anything resolves them."""
        return _unambiguous(self.believed) if self.resolved else self.believed

    def believed_by(self, options: EstimatorOptions) -> MeasurementModel:
        """Return what an estimator is given: of one that resolves phases itself, as if they were unambiguous."""
        return _unambiguous(self.believed) if options.resolves_phases else self.cleared


def _unambiguous(model: MeasurementModel) -> MeasurementModel:
    return model.unambiguous() if isinstance(model, InterferometerPhase) else model


@dataclass(frozen=True)
class PlacedSensor:
    """A sensor with its name and all kinds of measurement that it makes."""

    name: str
    field: Sensor
    kinds: Sequence[Measured]

    @property
    def models(self) -> list[MeasurementModel]:
        """What it measures, part by part."""
        return [model for kind in self.kinds for model in (kind.real, *kind.links)]

    @property
    def real(self) -> MeasurementModel:
        """What it measures."""
        return self.models[0] if len(self.models) == 1 else Stack(self.models)

    @property
    def clock(self) -> Periodic:
        """When it measures."""
        return self.kinds[0].clock

    @property
    def mask(self) -> ElevationMask | None:
        """What hides the target; None: nothing."""
        return self.kinds[0].mask


def placed_sensors(scenario: OwnScenario, places: Places) -> list[PlacedSensor]:
    """Return the sensors of a scenario, checked."""
    if not scenario.sensors:
        raise UserError("sensors: none is given; at least one is needed")
    check_along_track(scenario)
    found: list[PlacedSensor] = []
    for name, field in scenario.sensors.items():
        where = f"sensors.{name}"
        if field.minimum_elevation_deg is not None and not scenario.axes.geodetic:
            raise UserError(
                f"{where}.minimum_elevation_deg: it is for frame earth_fixed only, this is {scenario.frame}"
            )
        if field.offset_s > scenario.duration_s:
            raise UserError(f"{where}.offset_s: {field.offset_s:g} is not allowed; at most duration_s")
        _check_name(name, where, scenario)
        found.append(PlacedSensor(name, field, _measured(name, field, scenario, places)))
    _check_apart(found)
    known = [one.name for one in found] + [kind.name for one in found for kind in one.kinds]
    for name in scenario.belief.sensors:
        choose("belief.sensors", name, dict.fromkeys(known))
    return found


def used_rows(sensors: Sequence[PlacedSensor], options: EstimatorOptions, name: str) -> MeasurementModel:
    """Return what an estimator believes to be measured: the sensors, kinds and rows that it names, or all."""
    kinds = [kind for one in sensors for kind in one.kinds]
    models = {kind.name: kind.believed_by(options) for kind in kinds}
    if not options.measurements:
        return _side_by_side(list(models.values()))
    joint = {one.name: [kind.name for kind in one.kinds] for one in sensors}
    rows = {row: kind for kind, model in models.items() for row in model.names}
    wanted: dict[str, set[str]] = {}
    for chosen in options.measurements:
        choose(f"estimators.{name}.measurements", chosen, dict.fromkeys([*joint, *models, *rows]))
        whole = [chosen] if chosen in models else joint.get(chosen, [])
        for kind in whole:
            wanted.setdefault(kind, set()).update(models[kind].names)
        if not whole:
            wanted.setdefault(rows[chosen], set()).add(chosen)
    return _side_by_side(
        [
            model
            if wanted[kind] == set(model.names)
            else only(model, [row for row in model.names if row in wanted[kind]])
            for kind, model in models.items()
            if kind in wanted
        ]
    )


def _side_by_side(models: Sequence[MeasurementModel]) -> MeasurementModel:
    return models[0] if len(models) == 1 else Stack(models)


def differentiated(sensors: Sequence[PlacedSensor], motion: MotionModel) -> str:
    """Return a note on the models that have no derivative of their own; empty where all have one."""
    models = {kind.name: kind.believed for one in sensors for kind in one.kinds}
    names = [name for name, m in models.items() if isinstance(m, CustomMeasurement) and not m.has_jacobian]
    if isinstance(motion, CustomMotion) and not motion.has_transition:
        names.append("belief.motion")
    if not names:
        return ""
    return f"Jacobian of {', '.join(names)}: central differences, as the class has none of its own."


def _measured(name: str, field: Sensor, scenario: OwnScenario, places: Places) -> list[Measured]:
    """Return the kinds of measurement that a sensor makes."""
    where, beliefs, air = f"sensors.{name}", scenario.belief.sensors, air_of(scenario)
    if not isinstance(field, Joint):
        return [_kind(name, where, field, field, beliefs, scenario, places, air)]
    if not field.kinds:
        raise UserError(f"{where}.kinds: none is given; at least one is needed, such as tdoa: !Tdoa {{}}")
    whole = beliefs.get(name)
    if whole is not None and (not isinstance(whole, Joint) or set(whole.kinds) != set(field.kinds)):
        raise UserError(f"belief.sensors.{name}: it is not as sensors.{name}; a !Joint of {', '.join(field.kinds)}")
    if isinstance(whole, Joint):
        _check_timed_alike(whole, field, f"belief.sensors.{name}")
    found = []
    for kind, part in field.kinds.items():
        _check_name(kind, f"{where}.kinds", scenario)
        assumed: Mapping[str, Any] = beliefs
        path = "belief.sensors"
        if isinstance(whole, Joint):
            if kind in beliefs:
                raise UserError(f"belief.sensors.{kind}: it is not allowed beside belief.sensors.{name}, which has it")
            assumed, path = whole.kinds, f"belief.sensors.{name}.kinds"
        found.append(_kind(kind, f"{where}.kinds.{kind}", part, field, assumed, scenario, places, air, path))
    return found


def _kind(
    name: str,
    where: str,
    field: Kind,
    timed: Timed,
    beliefs: Mapping[str, Any],
    scenario: OwnScenario,
    places: Places,
    air: tuple[Air, Air],
    path: str = "belief.sensors",
) -> Measured:
    """Return one kind of measurement, as it is and as it is believed to be."""
    real, rows = _model(field, places, where)
    believed, belief = real, field
    chain = field.chain(places, where) if isinstance(field, Phase) else []
    if name in beliefs:
        assumed, path = beliefs[name], f"{path}.{name}"
        if isinstance(assumed, Joint):
            raise UserError(f"{path}: !Joint is not allowed; {where} is a !{type(field).__name__}")
        if isinstance(assumed, Timed):
            _check_timed_alike(assumed, timed, path)
        if isinstance(assumed, Phase) and isinstance(field, Phase):
            _check_resolved_alike(assumed, field, path, where)
        (believed, _), belief = _model(assumed, places, path), assumed
    if list(believed.names) != list(real.names):
        raise UserError(f"{path}: rows {list(believed.names)} are not allowed; the sensor has {list(real.names)}")
    real = seen_ahead(real, field, scenario, places, where)
    believed = seen_ahead(believed, belief, scenario, places, path)
    real = air[0].added_to(real, field, rows, places, where)
    believed = air[1].added_to(believed, belief, rows, places, where)
    rows = [*rows, *(row for _, own in chain for row in own)]
    return Measured(name, where, field, timed, real, believed, rows, [link for link, _ in chain])


def _check_timed_alike(assumed: Timed, timed: Timed, path: str) -> None:
    """Refuse a belief about when something is measured and what impairs it, which would be silently left out.

    A field that is not given has its default, which may be another than the sensor's.
    """
    usual = Timed()
    for one in fields(Timed):
        value = getattr(assumed, one.name)
        if value not in (getattr(usual, one.name), getattr(timed, one.name)):
            words = "estimators know when a row is there, and of no errors: it is said of the sensor alone"
            raise UserError(f"{path}.{one.name}: another one than the sensor's is not allowed; {words}")


def _check_resolved_alike(assumed: Phase, field: Phase, path: str, where: str) -> None:
    """Refuse a belief in another way of resolving phases, which would be silently left out."""
    for one in ("resolved_by", "chain_m"):
        value = getattr(assumed, one)
        if value and value != getattr(field, one):
            raise UserError(f"{path}.{one}: {value} is not allowed; how phases are resolved is said in {where}")


def _check_apart(sensors: Sequence[PlacedSensor]) -> None:
    """Refuse names and rows that are there twice."""
    names: dict[str, str] = {}
    rows: dict[str, str] = {}
    for one in sensors:
        mine = {one.name: f"sensors.{one.name}"}
        if isinstance(one.field, Joint):
            for kind in one.kinds:
                if kind.name in mine:
                    raise UserError(f"{kind.where}: the name {kind.name} is not allowed; the sensor has it itself")
                mine[kind.name] = kind.where
        for name, where in mine.items():
            if name in names:
                raise UserError(f"{where}: the name {name} is not allowed; {names[name]} has it already")
        names |= mine
        for kind in one.kinds:
            for model in (kind.real, *kind.links):
                for row in model.names:
                    if row in rows:
                        raise UserError(f"{kind.where}: row {row} is not allowed; {rows[row]} has it already")
                    rows[row] = kind.where


def _check_name(name: str, where: str, scenario: OwnScenario) -> None:
    if not NAME.fullmatch(name):
        raise UserError(f"{where}: the name {name!r} is not allowed; letters, digits and _, a letter first")
    if name in _TAKEN or name in scenario.estimators or name.endswith(_ENDS) or name.startswith(_BEGINS):
        raise UserError(f"{where}: the name {name} is not allowed; something else in the diagram has it")


def _model(field: Kind, places: Places, where: str) -> tuple[MeasurementModel, list[Row]]:
    try:
        return field.placed(places, where)
    except UserError:
        raise
    except ValueError as error:
        raise UserError(f"{where}: {error}") from error
