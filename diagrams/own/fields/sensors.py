"""Sensors of a system of one's own, as scenario fields: a kind of measurement with a clock of its own, or several."""

from __future__ import annotations

from dataclasses import dataclass, make_dataclass
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Any

from quietfix.diagrams.own.kinds.kind import MeasurementKind
from quietfix.diagrams.paths.places import Timed
from quietfix.systems.documented import documented
from quietfix.systems.registry import object_at

__all__ = ["KINDS", "Joint", "Kind", "Sensor", "TimedKind"]

KINDS: tuple[type[MeasurementKind], ...] = tuple(
    object_at(f"quietfix.diagrams.own.{path}")
    for path in (
        "kinds.tdoa:Tdoa",
        "kinds.toa:Toa",
        "kinds.fdoa:Fdoa",
        "kinds.range:Range",
        "kinds.range_rate:RangeRate",
        "kinds.frequency:Frequency",
        "kinds.bearing:Bearing",
        "kinds.altitude:Altitude",
        "kinds.rss:Rss",
        "kinds.phase:Phase",
        "kinds.relative:Relative",
        "classes.custom:Custom",
    )
)
"""Every kind of measurement, by its file and class; a new one is its file in ``kinds`` and one line here."""


@dataclass
class TimedKind(MeasurementKind, Timed):
    """A kind of measurement as a sensor: with a clock, a mask and errors of its own."""


def _timed(kind: type[MeasurementKind]) -> Any:
    """Return the sensor that measures a kind: its fields are those of `Timed`, and then those of the kind."""
    made = make_dataclass(kind.__name__, [], bases=(kind, TimedKind), namespace={"__doc__": kind.__doc__})
    made.__module__ = __name__
    return made


_SENSORS = {kind.__name__: _timed(kind) for kind in KINDS}


def __getattr__(name: str) -> Any:
    """Return the sensor of a kind by its name, as what imports or unpickles it asks for."""
    if name in _SENSORS:
        return _SENSORS[name]
    raise AttributeError(f"module {__name__} has no attribute {name}")


if TYPE_CHECKING:
    Kind = MeasurementKind
else:
    Kind = reduce(or_, KINDS)
"""Whatever is measured."""


@dataclass
class Joint(Timed):
    """Several kinds of measurement that are made together: one clock, one mask, one stream of noise, common errors."""

    kinds: dict[str, Kind] = documented(
        "what is measured, by names that estimators choose by; the rows are in this order", factory=dict
    )


if TYPE_CHECKING:
    Sensor = TimedKind | Joint
else:
    Sensor = reduce(or_, [*_SENSORS.values(), Joint])
"""Whatever measures."""
