"""What was run, line by line, with the meaning of each field where the system is known."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any, NamedTuple

from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.schema.scenario import dump
from quietfix.diagrams.studies.rerun import ask_as

__all__ = ["Line", "scenario_lines"]


class Line(NamedTuple):
    """A line of a scenario: the YAML, and what it means."""

    yaml: str
    meaning: str


def scenario_lines(attributes: Mapping[str, Any], path: str) -> tuple[list[Line], str]:
    """Return the scenario of a result, and a note where meanings are left out.

    Parameters
    ----------
    attributes : mapping
        Of the result; its system is looked up, but code that the result names is never imported.
    path : str
        Where it is, for messages.

    Returns
    -------
    lines : list of Line
    note : str
        Empty where all is known.
    """
    text, note = str(attributes.get("scenario", "")), ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            _, options = ask_as(attributes, f"--from: {path}", None, {}, False)
        text = dump(options["scenario"])
    except UserError as error:
        note = f"without the meanings of the fields: {error}"
    lines = []
    for line in text.splitlines():
        yaml, _, meaning = line.partition("  # ")
        lines.append(Line(yaml, meaning))
    return lines, note
