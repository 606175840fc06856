"""Errors, bounds and consistency against time, as numbers for a page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from quietfix.diagrams.figures.shared.style import COLOURS
from quietfix.diagrams.pages.numbers import rounded, thinned
from quietfix.diagrams.quantities.frame import UNITS
from quietfix.diagrams.statistics.consistency import chi_square_band
from quietfix.diagrams.statistics.state_errors import scored

__all__ = ["curves", "estimators", "verdicts"]

_MOST_EPOCHS = 800
_CONFIDENCE = 0.95
_DASHES = ("solid", "dash", "dashdot", "longdash", "longdashdot")  # dots are bounds
_SYMBOLS = ("circle", "square", "diamond", "triangle-up", "triangle-down")


def estimators(dataset: xr.Dataset) -> list[dict[str, str]]:
    """Return names, colours, dashes and symbols of the estimators, the same in every part of the page."""
    looks = {"color": COLOURS, "dash": _DASHES, "symbol": _SYMBOLS}  # their counts have no common factor: 35 looks
    return [
        {"name": str(name), **{what: kinds[i % len(kinds)] for what, kinds in looks.items()}}
        for i, name in enumerate(dataset["estimator"].values)
    ]


def curves(dataset: xr.Dataset, summary: Mapping[str, Any]) -> dict[str, Any]:
    """Return what ``summary.json`` says of every epoch.

    Parameters
    ----------
    dataset : xarray.Dataset
        The result; no array of its trials is read.
    summary : mapping
        What is in ``summary.json``.

    Returns
    -------
    dict
        ``time``, ``axis``; ``quantities``: name, unit, and by estimator ``rmse``, ``median``, ``bound`` and
        ``bound_truth``; ``nees`` and ``nis`` per degree of freedom with ``lower`` and ``upper`` of the 95 % band.
    """
    told = summary["estimators"]
    tracks = "epoch" in dataset.sizes
    count = max((len(row["nees_mean"]) for row in told.values()), default=0)
    time = np.arange(1.0, count + 1) if tracks else np.asarray(summary["time_s"], dtype=float)
    keep = thinned(count, _MOST_EPOCHS)

    def of(row: Mapping[str, Any], key: str) -> list[float | None]:
        values = row.get(key)
        return rounded(_numbers(values)[keep]) if values else []

    quantities = []
    for name, unit in UNITS.items():
        tail = f"{name}_{unit.replace('/', 'p')}"
        kinds = {"rmse": f"rmse_{tail}", "bound": f"bound_{tail}", "bound_truth": f"bound_truth_{tail}"}
        if name == "position":
            kinds["median"] = "median_position_m"
        rows = {kind: {one: of(row, key) for one, row in told.items()} for kind, key in kinds.items()}
        if any(value is not None for values in rows["rmse"].values() for value in values):
            quantities.append({"name": name, "unit": unit, **rows})
    return {
        "time": rounded(time[keep]),
        "axis": "epoch of the track" if tracks else str(dataset.attrs.get("axis", "time [s]")),
        "quantities": quantities,
        "nees": _nees(dataset, summary, keep),
        "nis": _nis(summary, keep),
        "left_out": int(count - keep.size),
    }


def _numbers(values: Any) -> Any:
    return np.array([np.nan if value is None else value for value in values], dtype=float)


def _nees(dataset: xr.Dataset, summary: Mapping[str, Any], keep: Any) -> dict[str, Any]:
    """Return the mean NEES over components judged, and the band of a consistent filter."""
    freedom = scored(dataset).sum("state")
    found = {}
    for name, row in summary["estimators"].items():
        n = max(1, int(freedom.sel(estimator=name)))
        trials = int(summary["trials"]) - int(row.get("not_started") or 0)
        low, high = chi_square_band(float(n * trials), float(n * trials), _CONFIDENCE)
        found[name] = {
            "mean": rounded(_numbers(row["nees_mean"])[keep] / n),
            "lower": rounded(low),
            "upper": rounded(high),
            "freedom": n,
        }
    return found


def _nis(summary: Mapping[str, Any], keep: Any) -> dict[str, Any]:
    found = {}
    for name, row in summary["estimators"].items():
        total, freedom = _numbers(row["nis_mean"])[keep], _numbers(row["nis_dof_mean"])[keep]
        with np.errstate(invalid="ignore", divide="ignore"):
            found[name] = {"mean": rounded(np.where(freedom > 0, total / freedom, np.nan))}
    return found


def verdicts(dataset: xr.Dataset, summary: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return a sentence or two of each estimator at the end: error against bound, and whether its covariance holds."""
    freedom = scored(dataset).sum("state")
    found = []
    for name, row in summary["estimators"].items():
        rmse, bound, nees = (_last(row, key) for key in ("rmse_position_m", "bound_position_m", "nees_mean"))
        trials = int(summary["trials"]) - int(row.get("not_started") or 0)
        words, good = [], "green"
        if rmse is None:
            words.append("the position error at the end is unknown, or infinite because trials are lost")
            good = "yellow"
        elif bound:
            words.append(f"RMSE of position at the end {rmse:.4g} m, {rmse / bound:.2f} times its bound")
        else:
            words.append(f"RMSE of position at the end {rmse:.4g} m; no bound is known")
        n = int(freedom.sel(estimator=name))
        if nees is not None and n and trials:
            low, high = (float(x) for x in chi_square_band(float(n * trials), float(trials), _CONFIDENCE))
            if nees > high:
                said, good = "above: it is further off than its covariance says", "red"
            elif nees < low:
                said, good = "below: its covariance is larger than its errors", "yellow"
            else:
                said = "inside: its covariance can be believed"
            words.append(f"mean NEES {nees:.3g}, 95 % band of a consistent filter {low:.3g} to {high:.3g}, {said}")
        for key, what in (("diverged", "diverged"), ("not_started", "never started")):
            if row.get(key):
                words.append(f"{row[key]} of {summary['trials']} trials {what}")
                good = "red"
        found.append({"name": name, "words": "; ".join(words) + ".", "style": good})
    return found


def _last(row: Mapping[str, Any], key: str) -> float | None:
    values = row.get(key)
    return values[-1] if values else None
