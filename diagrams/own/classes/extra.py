"""A user's own parts of a system of one's own."""

from __future__ import annotations

from dataclasses import dataclass

from quietfix.diagrams.assembly.bus import Bus
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.documented import choice, documented, text
from quietfix.systems.registry import blamed, object_at

__all__ = ["Custom"]


@dataclass
class Custom:
    """A part of one's own: a function, or a class, that puts blocks on the bus of signals.

    ``{class: package.module:function, options: {...}}`` is called as ``function(bus, **options)``, a class as
    ``Class(**options)(bus)``; see `quietfix.diagrams.assembly.bus.Bus`. What it publishes again (``target``,
    ``measurement``, ``known``) is what those after it get.
    """

    class_: str = text("where the function or the class is: package.module:name, beside this file, say")
    options: dict[str, bool | int | float | str] = documented("keyword arguments", factory=dict)
    before: str = choice("what it is put before", "estimators", ("sensors", "estimators"))
    signals: dict[str, str] = documented("what of its signals is logged, by its name in results", factory=dict)

    def part(self, where: str) -> _Part:
        """Return the part."""
        try:
            found = object_at(self.class_)
        except ValueError as error:
            raise UserError(f"{where}.{error}") from error
        if not callable(found):
            raise UserError(f"{where}.class: {self.class_} is not allowed; a function or a class")
        return _Part(self, where)


@dataclass(frozen=True)
class _Part:
    field: Custom
    where: str

    def __call__(self, bus: Bus) -> None:
        """See `quietfix.diagrams.assembly.model.Part`."""
        field, path = self.field, self.field.class_
        found = object_at(path)
        try:
            if isinstance(found, type):
                found(**field.options)(bus)
            else:
                found(bus, **field.options)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # whatever a user's code does, sys.exit too
            raise UserError(f"{self.where}: {blamed(path, error)}") from error
        for signal in field.signals.values():
            if signal not in bus:
                raise UserError(f"{self.where}.signals: {signal} is not there after {path}")
