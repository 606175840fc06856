"""How one of several models is followed by another, as a user writes it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from quietfix.systems.documented import documented, number
from quietfix.systems.filters.mode_chain import ModeChain

__all__ = ["Matrix", "Sojourn", "Transitions"]


class Transitions(ABC):
    """A chain of models."""

    @abstractmethod
    def chain(self, models: Sequence[str], where: str) -> ModeChain:
        """Return the chain of models with these names; `where`: name of the field, for messages."""


@dataclass
class Sojourn(Transitions):
    """How long each model holds in the mean; after it any other is as likely. Good for steps of any length."""

    mean_s: dict[str, float] = documented("by the name of the model [s]", factory=dict)

    def chain(self, models: Sequence[str], where: str) -> ModeChain:
        """See `Transitions.chain`."""
        for name in [*models, *self.mean_s]:
            if name not in self.mean_s or name not in models:
                raise ValueError(
                    f"{where}.mean_s: {', '.join(self.mean_s) or 'nothing'} is not allowed; one number > 0 for each of "
                    f"the models {', '.join(models)}"
                )
            if not 0 < self.mean_s[name] < float("inf"):
                raise ValueError(f"{where}.mean_s.{name}: {self.mean_s[name]:g} is not allowed; a finite number > 0")
        return ModeChain.of_sojourns([self.mean_s[name] for name in models])


@dataclass
class Matrix(Transitions):
    """Probabilities over a step: from the model of the row to the model of the column; each row sums to 1."""

    rows: list[list[float]] = documented("in the order of the models", factory=list)
    step_s: float = number("step that they are for [s]", 1.0, above=0)

    def chain(self, models: Sequence[str], where: str) -> ModeChain:
        """See `Transitions.chain`."""
        count = len(models)
        if len(self.rows) != count or any(len(row) != count for row in self.rows):
            shape = " + ".join(str(len(row)) for row in self.rows) or "no"
            raise ValueError(f"{where}.rows: {shape} numbers are not allowed; {count} rows of {count}")
        try:
            return ModeChain(self.rows, self.step_s)
        except ValueError as error:
            raise ValueError(f"{where}.rows: {error}".replace("rows: transitions: ", "rows: ")) from error
