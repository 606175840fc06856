"""What ``quietfix list`` prints of systems."""

from __future__ import annotations

from collections.abc import Sequence

from quietfix.diagrams.assembly.find import RECORDINGS, find, systems
from quietfix.diagrams.console.terminal import say
from quietfix.diagrams.schema.errors import UserError

__all__ = ["list_systems"]


def list_systems(chosen: Sequence[str] | None = None) -> None:
    """Print title, estimators and variants of some systems, or of all that have a name.

    Raises
    ------
    UserError
        For one of the chosen that is not there.
    """
    for name in chosen or [*systems(), *RECORDINGS]:
        try:
            lines = _lines(name)
        except UserError as error:
            if chosen:
                raise
            lines = [str(error)]  # an installed package that fails does not hide the others
        for line in lines:
            say(line)


def _lines(name: str) -> list[str]:
    found = find(name)
    own = found.system.load().estimators
    lines = [f"{found.reference}: {found.system.title}", f"  estimators: {', '.join(own) or 'none'}"]
    for variant in sorted(found.system.variants):
        extra = found.system.load(variant).estimators.keys() - own.keys()
        added = f" (and estimators {', '.join(sorted(extra))})" if extra else ""
        lines.append(f"  {found.reference}:{variant}{added}")
    return lines
