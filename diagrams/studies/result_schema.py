"""Which form of a study's result this version writes, and which earlier ones it reads."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import xarray as xr

from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.schema.scenario import read_yaml

__all__ = ["SCHEMA_VERSION", "check_version", "upgraded", "upgraded_scenario"]

_LATE = re.compile(r"(?<=\bclock_offset_platform: )\d+\b")

SCHEMA_VERSION = 2
"""1, which results do not say: estimators that look ahead are a text of their names, platforms and the rows of an
innovation have no names, and in a system of YAML the platform of a late clock is a number. 2: the coordinates
``causal``, ``platform``, ``coordinate`` and ``innovation_row``."""


def check_version(attributes: Mapping[str, Any], where: str) -> int:
    """Return the version of a result's schema.

    Parameters
    ----------
    attributes : mapping
        Of the result.
    where : str
        What a message begins with.

    Raises
    ------
    UserError
        If a later version of Quietfix wrote it, or it is no version.
    """
    version = attributes.get("schema_version", 1)
    whole = isinstance(version, int) and not isinstance(version, bool)
    if whole and version > SCHEMA_VERSION:
        raise UserError(
            f"{where}: schema_version: {version} is not allowed; 1 to {SCHEMA_VERSION}: a later version of Quietfix "
            "wrote it"
        )
    if not whole or version < 1:
        raise UserError(f"{where}: schema_version: {version!r:.80} is not allowed; 1 to {SCHEMA_VERSION}")
    return int(version)


def upgraded_scenario(text: str, version: int) -> str:
    """Return the scenario of a result of a system of YAML as this version reads it."""
    if version > 1 or not _LATE.search(text):
        return text
    platforms = read_yaml(text).get("platforms")
    named = platforms if isinstance(platforms, Mapping) else ()
    names = {str(i): str(name) for i, name in enumerate(named)} | {"0": "''"}  # that was the default
    return _LATE.sub(lambda found: names.get(found[0], found[0]), text)


def upgraded(dataset: xr.Dataset, version: int) -> xr.Dataset:
    """Return a result as this version writes it, as far as an earlier one can say; names that it lacks stay out."""
    if version > 1 or "estimator" not in dataset.coords:
        return dataset
    ahead = str(dataset.attrs.get("looks_ahead", "")).split(",")
    return dataset.assign_coords(causal=("estimator", [name not in ahead for name in dataset["estimator"].values]))
