"""Entries that ``comparison.json`` and ``sweep.json`` have in common."""

from __future__ import annotations

import math
import platform
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from quietfix.diagrams.schema.errors import UserError
from quietfix.diagrams.statistics.bootstrap import Interval, PairedBootstrap, interval
from quietfix.diagrams.statistics.consistency import chi_square_band
from quietfix.diagrams.statistics.json_numbers import json_numbers
from quietfix.diagrams.studies.result_schema import SCHEMA_VERSION

__all__ = ["interval_entry", "machine", "nearest_epoch", "nees_entry", "run_entry"]

Array = NDArray[np.float64]


def run_entry(dataset: xr.Dataset) -> dict[str, Any]:
    """Return of which system, variant, seed, number of trials and version a result is."""
    return {
        "schema_version": SCHEMA_VERSION,
        "system": dataset.attrs["system"],
        "variant": dataset.attrs["variant"] or None,
        "seed": int(dataset.attrs["seed"]),
        "trials": dataset.sizes["trial"],
        "version": dataset.attrs["version"],
    }


def nearest_epoch(times: Array, at: float | None) -> int:
    """Return the index of the epoch nearest to a time, by default of the last.

    Raises
    ------
    UserError
        If the time is outside the run.
    """
    if at is None:
        return len(times) - 1
    if not times[0] <= at <= times[-1]:
        raise UserError(f"at: {at:g} is not allowed; {times[0]:g} to {times[-1]:g} s")
    return int(np.argmin(np.abs(times - at)))


def nees_entry(
    values: Array, lost: NDArray[np.bool_], states: int, draws: PairedBootstrap, confidence: float
) -> dict[str, Any]:
    """Return the mean NEES per state, the band of a consistent filter, and where it lies.

    A trial that is lost has an infinite one: left out, those that survive would speak for all.
    """
    values = np.where(lost, np.inf, values)
    count = int(np.count_nonzero(~np.isnan(values)))
    per = states or math.nan  # none in common with the truth
    found = interval(draws.apply(values[:, None] / per, lambda means: means), confidence)
    lower, upper = (float(end) / per for end in chi_square_band(states * count, max(count, 1), confidence))
    mean = float(found.value[0])
    verdict = None
    if count and not math.isnan(mean):
        verdict = "low" if mean < lower else "high" if mean > upper else "in band"
    band = None if not (count and states) else {"low": lower, "high": upper}
    return {
        "states": states,
        "nees_per_state": interval_entry(found, 0),
        "nees_band": band,
        "nees_verdict": verdict,
    }


def interval_entry(found: Interval, index: int | tuple[()] = ()) -> dict[str, float | None]:
    """Return one value with its interval, as JSON has it."""
    return {name: json_numbers(np.asarray(part)[index]) for name, part in found._asdict().items()}


def machine() -> str:
    """Return what the costs were measured on."""
    name = platform.processor() or platform.machine()
    cpus = Path("/proc/cpuinfo")
    if cpus.is_file():
        lines = cpus.read_text(encoding="utf-8", errors="replace").splitlines()
        name = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), name)
    python = ".".join(map(str, sys.version_info[:3]))
    return f"{name}, Python {python}, drake {version('drake')}, numpy {np.__version__}"
