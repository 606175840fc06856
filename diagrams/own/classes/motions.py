"""A user's own motion model as what the estimators believe in."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.quantities.states import POSITION, VELOCITY
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.documented import documented, text
from quietfix.systems.motion.custom import CustomMotion, made

__all__ = ["Custom"]


@dataclass
class Custom:
    """A motion model of one's own: a subclass of `quietfix.systems.motion.base.MotionModel`; its transition may lack.

    Its states are x, y, z, vx, vy, vz in the axes of the frame.
    """

    class_: str = text("where the class is: package.module:Class, beside this file, say")
    options: dict[str, bool | int | float | str] = documented("keyword arguments of the class", factory=dict)

    def model(self, where: str) -> CustomMotion:
        """Return the motion model."""
        try:
            motion, has_transition = made(self.class_, self.options)
        except ValueError as error:
            raise UserError(f"{where}.{error}") from error
        found = CustomMotion(motion, has_transition, where, self.class_, UserError)
        states = (*POSITION, *VELOCITY)
        if found.names != states:
            raise UserError(f"{where}: {self.class_}.names: {found.names} is not allowed; {states}")
        return found
