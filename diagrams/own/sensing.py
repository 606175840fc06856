"""Sensors of a system of one's own, placed: with their models as they are and as they are believed to be."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

from diagrams.assembly.bus import Bus
from diagrams.errors import UserError, choose
from diagrams.own.places import Places
from diagrams.own.schema import OwnScenario
from diagrams.own.sensors import Bearing, Sensor, Tdoa, Toa
from diagrams.parts.impairment import Impaired, Mount
from diagrams.sensor_errors import refuse
from systems.clocks import Periodic
from systems.measurement.base import MeasurementModel
from systems.measurement.bearing import Bearing as BearingModel
from systems.measurement.custom import CustomMeasurement
from systems.measurement.differenced import Differenced
from systems.measurement.visibility import ElevationMask
from systems.plants.joined import Joined

__all__ = ["NAME", "PlacedSensor", "Together", "differentiated", "impaired", "placed_sensors"]

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
"""What a platform or a sensor may be called: rows and blocks are named after them."""

_TAKEN = {
    "assumed_height",
    "carriers",
    "flight",
    "initial_estimate",
    "known",
    "measured",
    "measurement",
    "measurements",
    "oscillator",
}
_TAKEN |= {
    "assumed_height",
    "platform_error",
    "platforms",
    "prediction",
    "prediction_covariance",
    "prior",
    "raw",
    "target",
    "truth",
}
_ENDS = ("_raw", "_reading_error", "_attitude_error")


@dataclass(frozen=True)
class PlacedSensor:
    """A sensor with its name, as it is and as it is believed to be."""

    name: str
    field: Sensor
    real: MeasurementModel
    believed: MeasurementModel

    @property
    def clock(self) -> Periodic:
        """When it measures."""
        return Periodic(self.field.every_s, self.field.offset_s)

    @property
    def mask(self) -> ElevationMask | None:
        """What hides the target; None: nothing."""
        elevation = self.field.minimum_elevation_deg
        return None if elevation is None else ElevationMask(math.radians(elevation), cast(Any, self.field.elevation_at))


def placed_sensors(scenario: OwnScenario, places: Places) -> list[PlacedSensor]:
    """Return the sensors of a scenario, checked."""
    if not scenario.sensors:
        raise UserError("sensors: none is given; at least one is needed")
    for name in scenario.belief.sensors:
        choose("belief.sensors", name, scenario.sensors)
    found: list[PlacedSensor] = []
    for name, field in scenario.sensors.items():
        where = f"sensors.{name}"
        if field.minimum_elevation_deg is not None and scenario.frame != "earth_fixed":
            raise UserError(
                f"{where}.minimum_elevation_deg: it is for frame earth_fixed only, this is {scenario.frame}"
            )
        if field.offset_s > scenario.duration_s:
            raise UserError(f"{where}.offset_s: {field.offset_s:g} is not allowed; at most duration_s")
        _check_name(name, where, scenario)
        real = _model(field, places, where)
        assumed = scenario.belief.sensors.get(name)
        believed = real if assumed is None else _model(assumed, places, f"belief.sensors.{name}")
        if list(believed.names) != list(real.names):
            raise UserError(
                f"belief.sensors.{name}: rows {list(believed.names)} are not allowed; the sensor has {list(real.names)}"
            )
        for other in found:
            twice = [row for row in real.names if row in other.real.names]
            if twice:
                raise UserError(f"{where}: row {twice[0]} is not allowed; sensors.{other.name} has it already")
        found.append(PlacedSensor(name, field, real, believed))
    return found


def differentiated(sensors: Sequence[PlacedSensor]) -> str:
    """Return a note on the models that have no Jacobian of their own; empty where all have one."""
    models = {one.name: one.believed for one in sensors}
    names = [name for name, m in models.items() if isinstance(m, CustomMeasurement) and not m.has_jacobian]
    if not names:
        return ""
    return f"Jacobian of {', '.join(names)}: central differences, as the class has none of its own."


def _check_name(name: str, where: str, scenario: OwnScenario) -> None:
    if not NAME.fullmatch(name):
        raise UserError(f"{where}: the name {name!r} is not allowed; letters, digits and _, a letter first")
    if name in _TAKEN or name in scenario.estimators or name.endswith(_ENDS):
        raise UserError(f"{where}: the name {name} is not allowed; something else in the diagram has it")


def _model(field: Sensor, places: Places, where: str) -> MeasurementModel:
    try:
        return field.model(places, where)
    except UserError:
        raise
    except ValueError as error:
        raise UserError(f"{where}: {error}") from error


def impaired(one: PlacedSensor, frame: str) -> Impaired:
    """Return the part that spoils what a sensor reads; a `UserError` names errors that it cannot have."""
    where, model = f"sensors.{one.name}.errors", one.real
    refused = {"platform": "platform_errors says how well the platforms are known"}
    mounts, clocks = [], {}
    if isinstance(one.field, Bearing) and isinstance(model, BearingModel) and frame == "local":
        mounts = [Mount(model.names, model.platform)]
    else:
        refused["attitude"] = "only a !Bearing in local axes has a direction that it may be off in"
    if isinstance(one.field, Tdoa | Toa) and isinstance(model, Differenced):
        pairs = zip(model.names, model.receivers, strict=True)
        clocks = {row: (receiver, model.reference) for row, receiver in pairs}
    else:
        refused["clock_offset"] = "only a !Tdoa or a !Toa compares clocks"
    refuse(one.field.errors, where, refused)
    raw = f"{one.name}_raw"
    return Impaired(
        model, one.clock, one.field.errors, mounts, clocks, takes=one.name, gives=[raw], prefix=f"{one.name}_"
    )


@dataclass(frozen=True)
class Together:
    """All sensors' rows side by side; a sensor off its own clock has none. Publishes ``measurement``."""

    names: Sequence[str]

    def __call__(self, bus: Bus) -> None:
        """See `diagrams.assembly.model.Part`."""
        raw = {name: f"{name}_raw" for name in self.names}
        if len(raw) == 1:
            bus.publish(measurement=bus[next(iter(raw.values()))])
            return
        shapes = {name: bus.shape(signal) for name, signal in raw.items()}
        bus.add(Joined(shapes, "measurements"), gives={"measurement": "state"}, takes=raw)
