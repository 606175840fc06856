"""What is behind the sensors of a system of one's own: their errors, and all their rows side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.own.declaring.sensing import Measured, PlacedSensor
from quietfix.diagrams.own.fields.sensors import KINDS
from quietfix.diagrams.parts.impairment import Impaired, Mount
from quietfix.diagrams.parts.sensor_errors import CommonErrors, SensorErrors, refuse
from quietfix.diagrams.quantities.frame import Frame
from quietfix.diagrams.schema.errors import choose
from quietfix.systems.plants.joined import Joined

__all__ = ["Together", "clocks_of", "impaired", "mounts_of"]

_DIRECTED = " and ".join(kind.directions for kind in KINDS if kind.directions)
_COMPARING = " or ".join(f"a !{kind.__name__}" for kind in KINDS if kind.compares_clocks)


def impaired(one: PlacedSensor, frame: Frame, platforms: Sequence[str]) -> Impaired:
    """Return the part that impairs what a sensor reads; a `UserError` names errors that it cannot have."""
    refused = {"platform": "platform_errors says how well the platforms are known"}
    mounts = [mount for kind in one.kinds for mount in mounts_of(kind, frame)]
    clocks = {row: pair for kind in one.kinds for row, pair in clocks_of(kind, list(platforms)).items()}
    if not mounts:
        refused["attitude"] = f"only {_DIRECTED} have a direction that they may be off in"
    if not clocks:
        refused["clock_offset"] = f"only {_COMPARING} compares clocks"
    where, errors = f"sensors.{one.name}.errors", one.field.errors
    refuse(errors, where, refused)
    compared = {number for pair in clocks.values() for number in pair}
    names = [name for number, name in enumerate(platforms) if number in compared]
    late = errors.clock_offset_platform or (names[0] if names else platforms[0])
    if names:
        choose(f"{where}.clock_offset_platform", late, names)
    common = {field.name: getattr(errors, field.name) for field in fields(CommonErrors)}
    return Impaired(
        one.real,
        one.clock,
        SensorErrors(**common, clock_offset_platform=list(platforms).index(late)),
        mounts,
        clocks,
        takes=one.name,
        gives=[f"{one.name}_raw"],
        prefix=f"{one.name}_",
    )


def mounts_of(kind: Measured, frame: Frame) -> list[Mount]:
    """Return which rows of a kind are directions, and in what axes."""
    return kind.field.mounts(kind.real, [row.name for row in kind.rows], frame)


def clocks_of(kind: Measured, platforms: list[str]) -> dict[str, tuple[int, int]]:
    """Return which rows of a kind compare the clocks of which receiver and reference."""
    compared = [row for row in kind.rows if row.compares_clocks]
    return {row.name: (platforms.index(row.receiver), platforms.index(row.reference)) for row in compared}


@dataclass(frozen=True)
class Together:
    """All sensors' rows side by side; a sensor off its own clock has none.

    Attributes
    ----------
    names : sequence of str
        Of the sensors.
    gives : sequence of str
        What it is called.
    """

    names: Sequence[str]
    gives: Sequence[str] = ("measurement",)

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        raw = {name: f"{name}_raw" for name in self.names}
        if len(raw) == 1:
            bus.publish(**dict.fromkeys(self.gives, bus[next(iter(raw.values()))]))
            return
        shapes = {name: bus.shape(signal) for name, signal in raw.items()}
        bus.add(Joined(shapes, "measurements"), gives=dict.fromkeys(self.gives, "state"), takes=raw)
