"""What a sensor of a system of one's own has around it, and what all of them have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from quietfix.diagrams.parts.latency import LatencyOptions
from quietfix.diagrams.parts.sensor_errors import CommonErrors
from quietfix.diagrams.quantities.frame import Frame
from quietfix.diagrams.schema.errors import UserError, choose
from quietfix.systems.documented import choice, documented, number, text
from quietfix.systems.trajectories.gravity import GravityConstants

__all__ = ["Errors", "Places", "Timed"]


@dataclass(frozen=True)
class Places:
    """What a sensor's model needs of its surroundings.

    Attributes
    ----------
    platforms : mapping of str to int
        Number of each platform by its name.
    frame : Frame
        The system's.
    constants : GravityConstants
        Of the Earth.
    bias : int, optional
        Which component of the state is the oscillator's error, where there is one.
    """

    platforms: Mapping[str, int]
    frame: Frame
    constants: GravityConstants
    bias: int | None = None

    def or_first(self, name: str) -> str:
        """Return the name of a platform, of the first one where it is empty."""
        return name or next(iter(self.platforms))

    def number(self, name: str, where: str) -> int:
        """Return the number of a platform; a `UserError` names the field where there is none of that name."""
        return self.platforms[choose(where, name, self.platforms)]

    def numbers(self, names: Sequence[str], where: str, without: str = "") -> dict[str, int]:
        """Return the numbers of platforms by name; of all but `without` where none is named."""
        wanted = list(names) or [name for name in self.platforms if name != without]
        if not wanted:
            raise UserError(f"{where}: no platform is left; at least one is needed")
        if len(set(wanted)) < len(wanted):
            raise UserError(f"{where}: {wanted} is not allowed; a platform is named twice")
        return {name: self.number(name, f"{where}.{i}") for i, name in enumerate(wanted)}


@dataclass
class Errors(CommonErrors):
    """Errors of a sensor that the estimators do not know of; all off by default."""

    clock_offset_platform: str = text("platform whose clock is ahead; empty: the first that the sensor compares")


@dataclass
class Timed:
    """When a sensor measures, what hides the target from it, and its errors."""

    every_s: float = number("time between measurements [s]", 1.0, above=0)
    offset_s: float = number("time of the first one [s]", 0.0, at_least=0)
    minimum_elevation_deg: float | None = number(
        "nothing is heard below this elevation [deg]; null: everything is, even through the Earth",
        None,
        at_least=-90,
        at_most=89,
    )
    elevation_at: str = choice("whose horizon counts", "platform", ("platform", "target"))
    latency_s: LatencyOptions = documented("how late what it measures comes", factory=LatencyOptions)
    errors: Errors = documented("errors that the estimators do not know of", factory=Errors)
