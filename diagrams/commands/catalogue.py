"""Scenarios of systems that a reference names."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from quietfix.diagrams.assembly.find import Found, find
from quietfix.diagrams.assembly.system import System
from quietfix.diagrams.schema.reading import fields_of
from quietfix.diagrams.schema.scenario import dump
from quietfix.diagrams.schema.yaml_text import load_yaml

__all__ = ["load_scenario", "meanings", "scenario_data", "variants"]


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


def scenario_data(scenario: Any) -> Any:
    """Return a scenario as YAML holds it: mappings, lists, numbers; where a tag chooses, it is under ``_tag``."""
    return load_yaml(dump(scenario, comments=False))


def meanings(scenario: Any, prefix: str = "") -> dict[str, str]:
    """Return what the fields of a scenario mean, with their units, by dotted key."""
    found: dict[str, str] = {}
    for key, field in fields_of(type(scenario)).items():
        value, name = getattr(scenario, field.name), f"{prefix}{key}"
        if field.doc:
            found[name] = field.doc
        parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
        for inner, part in [("", value), *((f".{k}", part) for k, part in parts)]:
            if dataclasses.is_dataclass(part):
                found |= meanings(part, f"{name}{inner}.")
    return found
