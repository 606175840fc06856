"""Where the fields of a scenario were written, for messages: ``drone.yaml:12: sensors.tdoa.sigma_ns: ...``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from quietfix.diagrams.schema.errors import UserError, shown
from quietfix.diagrams.schema.yaml_text import lines_of
from quietfix.systems.files import Unreadable, read_text

__all__ = ["Origins", "origins_of"]

_ATTRIBUTE = "_origins"  # no field: it is neither printed nor compared


@dataclass(frozen=True)
class Origins:
    """The files and settings that a scenario was laid together from.

    Attributes
    ----------
    files : sequence of Path
        The user's, those above later; they are read again only for a message.
    settings : sequence of str
        ``KEY=VALUE`` that were laid over them.
    """

    files: Sequence[Path] = ()
    settings: Sequence[str] = ()

    def remember(self, scenario: Any) -> None:
        """Keep with a scenario where it comes from."""
        setattr(scenario, _ATTRIBUTE, self)

    @contextmanager
    def placing(self) -> Iterator[None]:
        """Put file and line of the field before the message of a `UserError`."""
        try:
            yield
        except UserError as error:
            message = str(error)
            for file in self.files:
                message = message.removeprefix(f"{shown(file)}: ")
            place = self.place(message)
            if error.placed or not place:
                raise
            placed = UserError(f"{place}: {message}")
            placed.placed = True
            raise placed from error

    def place(self, message: str) -> str:
        """Return ``FILE:LINE`` of the field that a message begins with; ``FILE`` where no line is known.

        Empty where the message begins with something else, or a setting has changed the field.
        """
        keys = [setting.partition("=")[0].strip() for setting in self.settings]
        if any(_begins(message, key) or _begins(key, field) for key in keys for field in [message.partition(":")[0]]):
            return ""
        for file in reversed(self.files):
            lines = _lines(file)
            # a block begins with its own name, which is that of an estimator
            blocks = [
                path for path in lines if path.startswith("estimators.") and _begins(f"estimators.{message}", path)
            ]
            path = max((path for path in lines if _begins(message, path)), key=len, default="") or "".join(blocks[:1])
            if path:
                return f"{shown(file)}:{lines[path]}"
        return shown(self.files[0]) if self.files else ""


def origins_of(scenario: Any) -> Origins:
    """Return where a scenario comes from; nothing is known of one that was made in Python."""
    found = getattr(scenario, _ATTRIBUTE, None)
    return found if isinstance(found, Origins) else Origins()


def _begins(message: str, path: str) -> bool:
    """Return whether a message, or a longer path, begins with a path."""
    return message.startswith(path) and message[len(path) : len(path) + 1] in ("", ":", ".", " ")


def _lines(file: Path) -> dict[str, int]:
    try:
        return lines_of(read_text(file))
    except Unreadable:
        return {}
