"""Sensors of a system of one's own, as scenario fields: a kind of measurement with a clock of its own, or several."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.own.fields import kinds
from quietfix.diagrams.own.fields.kinds import Kind
from quietfix.diagrams.paths.places import Timed
from quietfix.systems.documented import documented

__all__ = [
    "Altitude",
    "Bearing",
    "Custom",
    "Fdoa",
    "Frequency",
    "Joint",
    "Phase",
    "Range",
    "RangeRate",
    "Relative",
    "Rss",
    "Sensor",
    "Tdoa",
    "Toa",
]


@dataclass
class Tdoa(kinds.Tdoa, Timed):
    """Time differences of arrival against a reference."""


@dataclass
class Toa(kinds.Toa, Timed):
    """Times of arrival of a signal whose time of emission nobody knows."""


@dataclass
class Fdoa(kinds.Fdoa, Timed):
    """Differences of the received frequency against a reference."""


@dataclass
class Range(kinds.Range, Timed):
    """Distances."""


@dataclass
class RangeRate(kinds.RangeRate, Timed):
    """Rates of the distances, positive away."""


@dataclass
class Frequency(kinds.Frequency, Timed):
    """Received frequencies, less the carrier: Doppler and, where the scenario has one, the emitter's oscillator."""


@dataclass
class Bearing(kinds.Bearing, Timed):
    """Azimuth and elevation at one platform, in local axes or over its horizon."""


@dataclass
class Altitude(kinds.Altitude, Timed):
    """The target's height, as it reports it or as it is assumed: above the ellipsoid, or z in local axes."""


@dataclass
class Rss(kinds.Rss, Timed):
    """Received powers of an emitter of known power, by the log-distance law."""


@dataclass
class Phase(kinds.Phase, Timed):
    """Phase differences of an interferometer that points to nadir: baseline a along the satellite's track, b across."""


@dataclass
class Relative(kinds.Relative, Timed):
    """What a satellite measures of another one, in inertial axes; null: that is not measured."""


@dataclass
class Custom(kinds.Custom, Timed):
    """A measurement model of one's own: ``!Custom {class: package.module:Class, options: {...}}``."""


@dataclass
class Joint(Timed):
    """Several kinds of measurement that are made together: one clock, one mask, one stream of noise, common errors."""

    kinds: dict[str, Kind] = documented(
        "what is measured, by names that estimators choose by; the rows are in this order", factory=dict
    )


Sensor = (
    Tdoa | Toa | Fdoa | Range | RangeRate | Frequency | Bearing | Altitude | Rss | Phase | Relative | Custom | Joint
)
"""Whatever measures."""
