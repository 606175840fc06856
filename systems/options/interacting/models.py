"""The motions of several models, as a user writes them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from quietfix.systems.biases.walking import WithBiases
from quietfix.systems.documented import documented, number, text
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.motion.custom import CustomMotion, made
from quietfix.systems.motion.manoeuvring.driven import Driven
from quietfix.systems.motion.side_by_side import SideBySide
from quietfix.systems.options import motions

__all__ = ["AsBelieved", "Custom", "model_of"]


class Relative(ABC):
    """A motion that is said with the system's own in mind."""

    @abstractmethod
    def model(self, believed: MotionModel, where: str) -> MotionModel:
        """Return the motion model, of the states of the motion that the system believes in."""


@dataclass
class AsBelieved(Relative):
    """The motion that the system believes in, with the noise of an acceleration in addition."""

    added_density_m2ps3: float = number(
        "power spectral density of the acceleration that is added, per axis [m^2/s^3]", 0.0, at_least=0
    )

    def model(self, believed: MotionModel, where: str) -> MotionModel:
        """See `Relative.model`."""
        return Driven(believed, self.added_density_m2ps3) if self.added_density_m2ps3 else believed


@dataclass
class Custom(Relative):
    """A motion of one's own: a subclass of `quietfix.systems.motion.base.MotionModel`; its transition may lack."""

    class_: str = text("where the class is: package.module:Class, beside this file, say")
    options: dict[str, bool | int | float | str] = documented("keyword arguments of the class", factory=dict)

    def model(self, believed: MotionModel, where: str) -> MotionModel:
        """See `Relative.model`."""
        try:
            motion, has_transition = made(self.class_, self.options)
        except ValueError as error:
            raise ValueError(f"{where}.{error}") from error
        return CustomMotion(motion, has_transition, where, self.class_)


def model_of(field: motions.FreeMotion | Relative, believed: MotionModel, level: bool, where: str) -> MotionModel:
    """Return a model's motion; what stands beside the target's own states keeps the motion that it has.

    Parameters
    ----------
    field : FreeMotion or Relative
        What the user wrote.
    believed : MotionModel
        The motion that the system believes in.
    level : bool
        Whether z is up everywhere.
    where : str
        Name of the field, for messages.

    Raises
    ------
    ValueError
        If the motion is not one of these states, or of a vertical that is none here.
    """
    if isinstance(believed, WithBiases):
        return WithBiases(model_of(field, believed.motion, level, where), believed.biases)
    if isinstance(believed, SideBySide):
        flight, *beside = believed.parts
        return SideBySide([model_of(field, flight, level, where), *beside])
    states = f"{where}: the states %s are not allowed; {', '.join(believed.names)}"
    if isinstance(field, Relative):
        try:
            own = field.model(believed, where)
        except ValueError as error:
            raise ValueError(str(error) if str(error).startswith(where) else f"{where}: {error}") from error
    else:
        if isinstance(field, motions.CoordinatedTurn) and not level:
            raise ValueError(f"{where}: !CoordinatedTurn is not allowed here; where z is up everywhere, frame local")
        own = field.model(max(2, sum(name in ("x", "y", "z") for name in believed.names)))
    if own.names != believed.names:
        raise ValueError(states % ", ".join(own.names))
    return own
