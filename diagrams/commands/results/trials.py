"""What is told of single trials: how they end, whether they are lost or never started and why, how they went."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import chi2

from quietfix.diagrams.statistics.epochs import along, by_number
from quietfix.diagrams.statistics.json_numbers import json_numbers
from quietfix.diagrams.statistics.lost import beyond, flagged, idle
from quietfix.diagrams.statistics.state_errors import errors, scored
from quietfix.diagrams.statistics.tally import blocks
from quietfix.diagrams.studies.starting import why_this

__all__ = ["Ends", "course_of", "ends_of", "of_a_sweep", "told_of"]

Array = NDArray[np.float64]

_READ = ("truth", "estimate", "nees", "nis", "nis_dof")
_READ_TOO = ("lost",)  # where there is one
_SURE = 0.999  # a covariance that is right makes a NEES beyond this share of chi-square once in a thousand epochs


@dataclass(frozen=True)
class Ends:
    """How the trials of one estimator end, (trial) each.

    Attributes
    ----------
    error : ndarray
        Position error at the last epoch whose truth is known [m]: infinite where the estimate is lost, NaN where no
        truth is known.
    nees : ndarray
        NEES at that epoch over the number of components that are judged.
    nis : ndarray
        Sum of the NIS over all epochs over the number of rows used.
    lost, never : ndarray of bool
        Whether the trial is lost at the end, although it started; whether it never started.
    flags : ndarray, (trial, 2), optional
        Whether the estimator itself calls the trial lost, at the last epoch and ever; see
        `quietfix.diagrams.statistics.lost.flagged`.
    """

    error: Array
    nees: Array
    nis: Array
    lost: NDArray[np.bool_]
    never: NDArray[np.bool_]
    flags: Array | None = None

    def of(self, places: Any) -> Ends:
        """Return the same of some of the trials."""
        flags = None if self.flags is None else self.flags[places]
        numbers = self.error[places], self.nees[places], self.nis[places]
        return Ends(*numbers, self.lost[places], self.never[places], flags)

    @property
    def flagged(self) -> tuple[int | None, int | None]:
        """How many trials the estimator calls lost at the last epoch, and ever; None: not known."""
        if self.flags is None:
            return None, None
        at_end, ever = self.flags.sum(axis=0)
        return int(at_end), int(ever)

    @property
    def rmse(self) -> float:
        """Root mean square of the errors of the trials that started [m]; infinite where one is lost."""
        known = self.error[~self.never & ~np.isnan(self.error)]
        return float(np.sqrt(np.mean(known**2))) if known.size else np.nan

    @property
    def median(self) -> float:
        """Their median [m]."""
        known = np.sort(self.error[~self.never & ~np.isnan(self.error)])
        if not known.size:
            return np.nan
        low, high = known[(known.size - 1) // 2], known[known.size // 2]
        return float(high if np.isinf(high) else (low + high) / 2)

    def worst(self, count: int) -> list[int]:
        """Return so many trials, by place: with the largest errors or, where no truth is known, the largest NIS."""
        measure = self.error if not np.isnan(self.error).all() else self.nis
        order = np.lexsort((np.arange(measure.size), -np.where(np.isnan(measure), -np.inf, measure)))
        return [int(i) for i in order[:count] if not np.isnan(measure[i])]


def ends_of(dataset: xr.Dataset, names: list[str]) -> dict[str, Ends]:
    """Return how all trials of a study's result end, by estimator; the result is read chunk by chunk."""
    found: dict[str, list[Ends]] = {name: [] for name in names}
    read = [*_READ, *(name for name in _READ_TOO if name in dataset)]
    for _, block in blocks(by_number(dataset)[read].sel(estimator=names)):
        some = block.load()
        for name in names:
            found[name].append(_ends(some.sel(estimator=[name])))
    whole: dict[str, Ends] = {}
    for name, each in found.items():
        flags = [one.flags for one in each if one.flags is not None]
        whole[name] = Ends(
            np.concatenate([one.error for one in each]),
            np.concatenate([one.nees for one in each]),
            np.concatenate([one.nis for one in each]),
            np.concatenate([one.lost for one in each]),
            np.concatenate([one.never for one in each]),
            np.concatenate(flags) if flags else None,
        )
    return whole


def _ends(one: xr.Dataset) -> Ends:
    position = errors(one, ("position",))["position"]
    never, lost = idle(position).values[0], beyond(position, float(one.attrs["divergence_m"])).values[0]
    error = position.values[0]
    last = error.shape[-1] - 1 - np.argmax(~np.isnan(error)[:, ::-1], axis=-1)
    place = (np.arange(error.shape[0]), last)
    states = float(scored(one).sum())
    nees = one["nees"].transpose("estimator", "trial", "time").values[0][place] / (states or np.nan)
    flags = flagged(one)
    return Ends(error[place], nees, _per_row(one, "time"), lost & ~never, never, None if flags is None else flags[0])


def _per_row(one: xr.Dataset, axis: str) -> Array:
    """Return the sum of the NIS over that of the rows used, (trial), of one estimator."""
    nis, rows = (one[name].transpose("estimator", "trial", axis).values[0] for name in ("nis", "nis_dof"))
    known = ~np.isnan(nis) & (rows > 0)
    total, used = np.where(known, nis, 0.0).sum(axis=-1), np.where(known, rows, 0.0).sum(axis=-1)
    return np.asarray(total / np.where(used > 0, used, np.nan))


# -------------------------------------------------------------------------------------------------- one trial


def told_of(dataset: xr.Dataset, name: str, place: int) -> dict[str, Any]:
    """Return what is told of one trial of an estimator, as JSON has it.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result.
    name : str
        The estimator.
    place : int
        Of the trial in the result, from 0.

    Returns
    -------
    dict
        ``trial``, ``track`` of a recording, ``position_error_m`` at the end, ``largest_error_m`` of those that are
        finite and ``largest_at_s``, ``nees_per_state`` at the end, ``nis_per_row`` over all epochs, ``state``:
        ``kept``, ``lost`` or ``never started``, ``why``, ``flagged``: whether the estimator itself calls it lost at the
        end (None: not known), and ``flagged_from_s``, since when it first did.
    """
    one = dataset.isel(trial=[place]).sel(estimator=[name]).load()
    ends = _ends(by_number(one))
    course = course_of(one)
    error, times = course["position_error_m"], course["time_s"]
    state = "never started" if ends.never[0] else "lost" if ends.lost[0] else "kept"
    why = why_this(one) if ends.never[0] else _why_lost(one, course) if ends.lost[0] else None
    found = np.flatnonzero(np.isfinite(error))
    peak = int(found[np.argmax(error[found])]) if found.size else None
    track = {"track": str(one["track"].values[0])} if "track" in one.coords else {}
    return {
        "trial": int(one["trial"].values[0]),
        **track,
        "position_error_m": json_numbers(ends.error[0]),
        "largest_error_m": None if peak is None else json_numbers(error[peak]),
        "largest_at_s": None if peak is None else json_numbers(times[peak]),
        "nees_per_state": json_numbers(ends.nees[0]),
        "nis_per_row": json_numbers(ends.nis[0]),
        "state": state,
        "why": why,
        "flagged": None if ends.flags is None else bool(ends.flags[0, 0]),
        "flagged_from_s": json_numbers(times[calls[0]]) if (calls := _calls(course)).size else None,
    }


def _calls(course: dict[str, Array]) -> NDArray[np.intp]:
    """Return the epochs at which an estimator calls its trial lost."""
    return np.flatnonzero(course["lost"] > 0) if "lost" in course else np.zeros(0, dtype=np.intp)


def course_of(one: xr.Dataset) -> dict[str, Array]:
    """Return how one trial of one estimator goes, (epoch) each; the result has no more than these.

    ``time_s``, the errors that there are (see `quietfix.diagrams.statistics.state_errors.errors`) as ``QUANTITY_error``
    with their unit, ``nees_per_state``, ``nis`` and ``nis_dof``: how many rows were used, and ``lost``, where the
    result has it: whether the estimator calls it lost.
    """
    axis = along(one)
    times = np.asarray(one["time"].values, dtype=float).reshape(-1)
    there = ~np.isnan(times)
    units = {"position": "m", "height": "m", "velocity": "mps", "speed": "mps", "course": "deg", "bias": "mps"}
    states = float(scored(one).sum()) or np.nan
    found = {"time_s": times}
    found |= {f"{what}_error_{units[str(what)]}": values.values[0, 0] for what, values in errors(one).items()}
    names = [*("nees", "nis", "nis_dof"), *(name for name in _READ_TOO if name in one)]
    kept = {name: one[name].transpose("estimator", "trial", axis).values[0, 0] for name in names}
    found |= {"nees_per_state": kept.pop("nees") / states, **kept}
    return {name: np.asarray(values, dtype=float)[there] for name, values in found.items()}


def _why_lost(one: xr.Dataset, course: dict[str, Array]) -> str:
    """Return since when a trial is lost, what was before, and whether its covariance tells."""
    limit = float(one.attrs["divergence_m"])
    error, times, rows = course["position_error_m"], course["time_s"], course["nis_dof"]
    judged = np.flatnonzero(~np.isnan(error))
    broken = not np.isfinite(error[judged[-1]])
    within = judged[np.isfinite(error[judged]) if broken else error[judged] <= limit]
    after = judged[judged > within[-1]] if within.size else judged
    onset = int(after[0])
    words = "its estimate is no number" if broken else f"further off than divergence_m, {limit:g} m,"
    said = [f"{words} from {times[onset]:g} s on"]
    silent = _silent_before(rows, onset)
    if silent:
        since = f"{times[onset - silent]:g} s" if silent < onset else "the start"
        said.append(f"nothing measured at the {silent} epoch{'s' * (silent > 1)} before, from {since} on")
    if not broken:
        said.append(_covariance(course["nees_per_state"][onset], float(scored(one).sum())))
    return "; ".join(said)


def _silent_before(rows: Array, onset: int) -> int:
    """Return at how many epochs just before one no row was used."""
    used = np.flatnonzero(rows[:onset] > 0)
    return onset - (int(used[-1]) + 1 if used.size else 0)


def _covariance(nees: float, states: float) -> str:
    if np.isnan(nees):
        return "its covariance is not positive definite there"
    limit = float(chi2.ppf(_SURE, states)) / states
    how = "does not tell" if nees > limit else "tells"
    return f"its covariance {how} (NEES/n {nees:.3g} there; a right one is below {limit:.3g} in {_SURE:.1%} of cases)"


def of_a_sweep(dataset: xr.Dataset, name: str) -> Iterator[tuple[float, Ends]]:
    """Yield how the trials of one estimator of a sweep end, point by point, with the value that is varied."""
    for k, value in enumerate(dataset["point"].values):
        one = dataset.isel(point=k).sel(estimator=name)
        states = float(one["states"]) or np.nan
        error, nees = one["position_error"].values, one["nees"].values / states
        flags = one["diverged"].values.astype(bool), one["not_started"].values.astype(bool)
        yield float(value), Ends(error, nees, np.full(error.shape, np.nan), *flags)
