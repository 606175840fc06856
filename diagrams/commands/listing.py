"""What ``quietfix list`` prints of systems."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from quietfix.diagrams.assembly.find import RECORDINGS, find, systems
from quietfix.diagrams.console.answer import asked_for_json, tell
from quietfix.diagrams.console.terminal import say
from quietfix.diagrams.schema.errors import UserError
from quietfix.systems.registry import ESTIMATORS

__all__ = ["list_systems"]


def list_systems(chosen: Sequence[str] | None = None) -> None:
    """Print title, estimators and variants of some systems, or of all that have a name and what else there is.

    Raises
    ------
    UserError
        For one of the chosen that is not there.
    """
    listed = []
    for name in chosen or [*systems(), *RECORDINGS]:
        try:
            listed.append(_listed(name))
        except UserError as error:
            if chosen:
                raise
            listed.append({"name": name, "error": str(error)})  # a package that fails does not hide the others
    tell(systems=listed)
    if not chosen:
        tell(registered_estimators=list(ESTIMATORS), recordings=list(RECORDINGS))
    if asked_for_json():
        return
    for line in (line for one in listed for line in _lines(one)):
        say(line)
    if not chosen:
        say(f"registered estimators: {', '.join(ESTIMATORS)}")
        say(f"recordings, also for `quietfix replay`: {', '.join(RECORDINGS)}")


def _listed(name: str) -> dict[str, Any]:
    """Return what is said of a system; of its variants the estimators that they add."""
    found = find(name)
    own = found.system.load().estimators
    variants = {
        variant: sorted(found.system.load(variant).estimators.keys() - own.keys())
        for variant in sorted(found.system.variants)
    }
    return {"name": found.reference, "title": found.system.title, "estimators": list(own), "variants": variants}


def _lines(one: Mapping[str, Any]) -> list[str]:
    if "error" in one:
        return [one["error"]]
    lines = [f"{one['name']}: {one['title']}", f"  estimators: {', '.join(one['estimators']) or 'none'}"]
    for variant, extra in one["variants"].items():
        added = f" (and estimators {', '.join(extra)})" if extra else ""
        lines.append(f"  {one['name']}:{variant}{added}")
    return lines
