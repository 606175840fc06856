"""What a run on measurements of one's own tells: where each target is at the end, how well, and if to believe it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import chi2

from quietfix.diagrams.console.tables import Column, Styled, Table, three_digits
from quietfix.diagrams.own.fed.covering import Covering, judge, residuals_of
from quietfix.diagrams.quantities.frame import frame_of
from quietfix.diagrams.quantities.states import POSITION
from quietfix.diagrams.statistics.consistency import chi_square_band
from quietfix.diagrams.statistics.epochs import along
from quietfix.diagrams.writers.estimates import estimate_columns, write_estimates
from quietfix.diagrams.writers.tracks import MOST_ORBITS, write_tracks
from quietfix.systems.earth.geodetic import ecef_to_geodetic, enu_rotation
from quietfix.systems.earth.time_scales import from_tai

__all__ = ["MeasuredReport", "Told", "measured_report"]

Array = NDArray[np.float64]

_MOST = 20  # targets in the table that is printed; all are in summary.json
_DEEP = -500.0  # m: no land lies lower


@dataclass(frozen=True)
class Told:
    """What one estimator says of one target.

    Attributes
    ----------
    estimator, target : str
    epochs, updates : int
        How many there are, and in how many the measurement was used.
    time : float or None
        Of the last epoch with an estimate [s]; None: it never started.
    place : dict of str to float
        The estimate there, by names with units.
    sigma : dict of str to float
        One standard deviation of the position along the axes there [m].
    nis : float or None
        Sum of the NIS over its degrees of freedom: 1 where residuals are as large as they are believed to be.
    low, high : float or None
        Where that lies in 95 of 100 runs if they are.
    larger : float or None
        How many times as large as believed residuals are in the middle of the epochs: the root of the median of the NIS
        over its median if they are as believed. A start that is off, or one gross error, does not count.
    covering : Covering
        Whether what is claimed covers the residuals.
    """

    estimator: str
    target: str
    epochs: int
    updates: int
    time: float | None
    place: Mapping[str, float]
    sigma: Mapping[str, float]
    nis: float | None
    low: float | None
    high: float | None
    larger: float | None
    covering: Covering


def measured_report(
    result: xr.Dataset, names: Sequence[str], claimed: Mapping[str, float], began: tuple[int, float] | None, known: bool
) -> MeasuredReport:
    """Return what is told of a study's result.

    Parameters
    ----------
    result : xarray.Dataset
    names : sequence of str
        Of all targets; the result may have some of them.
    claimed : mapping of str to float
        Standard deviation of each row as it is believed to be [SI].
    began : (int, float), optional
        t = 0 in seconds of TAI since 1970.
    known : bool
        Whether the truth is.
    """
    targets = [names[int(number)] for number in result["trial"].values]
    result = result.assign_coords(track=("trial", targets))
    axis = along(result)
    time = np.broadcast_to(result["time"].values, (result.sizes["trial"], result.sizes[axis]))
    told = [
        _told(result.sel(estimator=name).isel(trial=k), str(name), target, time[k], claimed)
        for k, target in enumerate(targets)
        for name in result["estimator"].values
    ]
    return MeasuredReport(told, result, began, known, str(result.attrs["system"]), str(result.attrs["note"]))


def _told(one: xr.Dataset, name: str, target: str, time: Array, claimed: Mapping[str, float]) -> Told:
    epochs = np.isfinite(time)
    estimate = one["estimate"].transpose(..., "state").values
    states = [str(state) for state in one["state"].values]
    place = [states.index(axis) for axis in POSITION if axis in states]
    started = np.flatnonzero(np.isfinite(estimate[:, place]).all(axis=-1) & epochs)
    freedom, nis = one["nis_dof"].values, one["nis"].values
    used = np.isfinite(nis) & (freedom > 0)
    total = float(freedom[used].sum())
    low, high = (float(edge) for edge in chi_square_band(total, total)) if total else (math.nan, math.nan)
    where: dict[str, float] = {}
    sigma: dict[str, float] = {}
    if started.size:
        last = int(started[-1])
        where, sigma = _place(one, estimate[last], one["covariance"].values[last], place)
    return Told(
        name,
        target,
        int(epochs.sum()),
        int(used.sum()),
        float(time[started[-1]]) if started.size else None,
        where,
        sigma,
        float(nis[used].sum() / total) if total else None,
        low if total else None,
        high if total else None,
        float(np.sqrt(np.median(nis[used] / chi2.median(freedom[used])))) if total else None,
        judge(nis[used], freedom[used], time[used], residuals_of(one, claimed)),
    )


def _place(
    one: xr.Dataset, state: Array, covariance: Array, place: list[int]
) -> tuple[dict[str, float], dict[str, float]]:
    """Return where a target is and one standard deviation of it, along the axes that a user thinks in."""
    position, spread = state[place], covariance[np.ix_(place, place)]
    axes: tuple[str, ...] = POSITION
    if frame_of(one).geodetic and len(place) == 3:
        latitude, longitude, height = (float(part) for part in ecef_to_geodetic(position))
        turn = enu_rotation(latitude, longitude)
        spread, axes = turn @ spread @ turn.T, ("east", "north", "up")
        where = {"latitude_deg": math.degrees(latitude), "longitude_deg": math.degrees(longitude), "height_m": height}
    else:
        where = {f"{axis}_m": float(part) for axis, part in zip(POSITION, position, strict=False)}
    sigmas = np.sqrt(np.maximum(np.diagonal(spread), 0.0))
    return where, {f"sigma_{axis}_m": float(part) for axis, part in zip(axes, sigmas, strict=False)}


@dataclass(frozen=True, eq=False)
class MeasuredReport:
    """What came out of a table of measurements.

    Attributes
    ----------
    told : list of Told
        By target and estimator.
    result : xarray.Dataset
        With the names of the targets as ``track``.
    began : (int, float), optional
        t = 0 in seconds of TAI since 1970.
    known : bool
        Whether the truth is: errors are told of every study that has one.
    system, note : str
        What it is, and what a reader must know.
    """

    told: list[Told]
    result: xr.Dataset
    began: tuple[int, float] | None
    known: bool
    system: str
    note: str

    def table(self) -> Table:
        """Return the table that is printed."""
        some = next((one for one in self.told if one.place), self.told[0])
        heads = [name.replace("_", " [", 1) + "]" for name in some.place]
        sigmas = [f"{name.split('_')[1]} ± [m]" for name in some.sigma]
        table = Table(
            f"{self.system}: estimates at the end",
            [Column("target"), Column("estimator"), "at [s]", *heads, *sigmas, "updates", "NIS/dof"],
            keys=2,
            caption="±: one standard deviation as the estimator believes it; NIS/dof: 1 if the residuals are as large "
            "as that, * if it is outside of where it lies in 95 of 100 runs.",
        )
        targets = list(dict.fromkeys(one.target for one in self.told))[:_MOST]
        for one in self.told:
            if one.target in targets:
                table.add(*_cells(one, len(heads), len(sigmas)))
        return table

    def notes(self) -> list[str]:
        """Return lines for below the table."""
        targets = len({one.target for one in self.told})
        lines = [f"{targets - _MOST} more targets are in summary.json and estimates.csv"] if targets > _MOST else []
        lines += [
            f"{one.target}: {one.estimator} never started: the start finds no solution at any epoch"
            for one in self.told
            if one.time is None
        ]
        lines += [
            f"{one.target}: {one.estimator} ends {-one.place['height_m']:.0f} m below the ellipsoid, under the ground: "
            "receivers in a plane hear an image below it as well as what is above; a start that is higher, or an error"
            for one in self.told
            if one.place.get("height_m", 0.0) < _DEEP
        ][:_MOST]
        said = (one.covering.said(f"{one.target}: ", one.estimator, one.larger) for one in self.told)
        lines += [line for line in said if line][:_MOST]
        if len(self.told) > MOST_ORBITS and self.began is not None and frame_of(self.result).geodetic:
            lines.append(f"orbits (.oem) are written of the first {MOST_ORBITS} of {len(self.told)} tracks only")
        if not self.known:
            lines.append("nobody knows where the target was: no errors, only what the estimators say of themselves")
        return [*lines, *([self.note] if self.note and not self.known else []), self._clock()]

    def _clock(self) -> str:
        """Return in words what times are."""
        if self.began is None:
            return "times are seconds of the table's own clock: nothing says of which scale"
        return f"t = 0 is {from_tai(*self.began)}Z (UTC): seconds are those of TAI, leap seconds counted; dates are UTC"

    def summary(self) -> dict[str, Any]:
        """Return numbers for ``summary.json``."""
        zero = None if self.began is None else f"{from_tai(*self.began)}Z"
        found: dict[str, Any] = {"start_utc": zero, "targets": [_entry(one) for one in self.told]}
        if not self.known:
            names = dict.fromkeys(one.estimator for one in self.told)
            never = {name: sum(one.time is None for one in self.told if one.estimator == name) for name in names}
            found["estimators"] = {name: {"diverged": None, "not_started": never[name]} for name in names}
        return found

    def draw(self, folder: Path) -> list[Path]:
        """Write the estimates into a folder."""
        return [
            *write_estimates(estimate_columns(self.result, self.began), folder),
            *write_tracks(self.result, self.began, folder),
        ]


def _cells(one: Told, places: int, sigmas: int) -> list[str | Styled]:
    if one.time is None:
        return [one.target, one.estimator, *["-"] * (1 + places + sigmas), str(one.updates), "-"]
    shown = [f"{value:.6f}" if name.endswith("_deg") else f"{value:.1f}" for name, value in one.place.items()]
    odd = one.nis is not None and not (one.low or 0) <= one.nis <= (one.high or math.inf)
    nis = f"{three_digits(one.nis)}{'*' if odd else ''}"
    spread = [three_digits(value) for value in one.sigma.values()]
    return [one.target, one.estimator, f"{one.time:.10g}", *shown, *spread, str(one.updates), nis]


def _entry(one: Told) -> dict[str, Any]:
    return {
        "target": one.target,
        "estimator": one.estimator,
        "epochs": one.epochs,
        "updates": one.updates,
        "time_s": one.time,
        **one.place,
        **one.sigma,
        "nis_per_dof": one.nis,
        "nis_per_dof_low": one.low,
        "nis_per_dof_high": one.high,
        "residuals_over_believed": one.larger,
        **one.covering.summary(),
    }
