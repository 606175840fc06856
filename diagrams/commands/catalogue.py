"""Scenarios of systems that a reference names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from quietfix.diagrams.assembly.find import Found, find
from quietfix.diagrams.assembly.system import System

__all__ = ["load_scenario", "variants"]


def load_scenario(
    system: str | System | Found,
    variant: str | None = None,
    file: Path | str | None = None,
    settings: Sequence[str] = (),
    text: str | None = None,
    trust: bool = False,
) -> Any:
    """Return the scenario of a system, laid together from its layers.

    Parameters
    ----------
    system : str or System
        See `quietfix.diagrams.assembly.find.find`.
    variant, file, settings, text, trust
        See `System.load`.

    Raises
    ------
    UserError
        Naming the field, the value and what is allowed, or a class that the text names without `trust`.
    """
    found = find(system, variant)
    return found.system.load(found.variant, file, settings, text, trust)


def variants(system: str | System | Found) -> list[str]:
    """Return the names of a system's variants; `system` as of `quietfix.diagrams.assembly.find.find`."""
    return sorted(find(system).system.variants)
