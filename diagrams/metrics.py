"""How good the estimates of a study are: errors, RMSE, medians, consistency, convergence, divergence.

Everything is a function of a study's result (`diagrams.run_study`), over all trials and epochs at once. Where the
*truth* is NaN the error is NaN: nothing is known there, and the trial is left out at that epoch. Where the *estimate*
is not finite the error is infinite: a lost trial stays in every RMSE and median, and its infinity becomes null
in ``summary.json``.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2

from diagrams.states import POSITION, VELOCITY
from systems.angle_wrapping import wrap
from systems.frames import course_speed, ecef_to_geodetic

__all__ = [
    "BOUNDS",
    "NEEDED",
    "QUANTITIES",
    "armse",
    "axis_errors",
    "bias_and_spread",
    "causal",
    "chi_square_band",
    "convergence_time",
    "diverged",
    "errors",
    "median",
    "nees_statistics",
    "nis_statistics",
    "not_started",
    "percentile",
    "rmse",
    "scored",
    "summarise",
]

Array = NDArray[np.float64]

QUANTITIES = ("position", "height", "velocity", "speed", "course", "bias")
"""What errors and bounds are about: position and height [m], velocity and horizontal speed [m/s], course [deg], and
bias [m/s] where it is in the state."""

NEEDED = {
    "position": POSITION,
    "height": POSITION,
    "velocity": VELOCITY,
    "speed": (*POSITION, *VELOCITY),
    "course": (*POSITION, *VELOCITY),
    "bias": ("bias",),
}
"""Which components of the state each of `QUANTITIES` is made of."""

BOUNDS = tuple(f"{kind}_{what}" for kind in ("bound", "bound_truth") for what in QUANTITIES)
"""Names of the bounds that a result may carry, each (estimator, time), in the units of `QUANTITIES`."""

_UNITS = dict(zip(QUANTITIES, ("m", "m", "mps", "mps", "deg", "mps"), strict=True))
_AT_REST = 1e-6  # m/s; below it a course means nothing
_HUGE = 1e150  # stands for infinity while percentiles are interpolated; its square is still finite


# --------------------------------------------------------------------------------------------------- errors


def scored(dataset: xr.Dataset) -> xr.DataArray:
    """Return which components each estimator can be judged by: those that its state and the truth both have.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result; without the coordinates ``in_truth`` and ``in_estimate`` all have all.

    Returns
    -------
    xarray.DataArray of bool, dims (estimator, state)
    """
    shape = dataset.sizes["estimator"], dataset.sizes["state"]
    both = np.ones(shape, dtype=bool)
    if "in_truth" in dataset.coords:
        both &= dataset["in_truth"].values
    if "in_estimate" in dataset.coords:
        both &= dataset["in_estimate"].transpose("estimator", "state").values
    names = {name: dataset[name].values for name in ("estimator", "state")}
    return xr.DataArray(both, names, ("estimator", "state"))


def causal(dataset: xr.Dataset, estimator: str) -> bool:
    """Return whether an estimator uses no measurement before it is made, as far as a result says it."""
    return "causal" not in dataset.coords or bool(dataset["causal"].sel(estimator=estimator))


def axis_errors(dataset: xr.Dataset) -> xr.DataArray:
    """Return estimate minus truth per component of the state.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result.

    Returns
    -------
    xarray.DataArray, dims (estimator, trial, time, state)
        NaN where the truth is unknown or the component is not in both states, infinite where the estimate is not
        finite.
    """
    difference = dataset["estimate"] - dataset["truth"]
    lost = ~np.isfinite(dataset["estimate"]) & np.isfinite(dataset["truth"]) & scored(dataset)
    return difference.where(~lost, np.inf).transpose("estimator", "trial", "time", "state")


def errors(dataset: xr.Dataset) -> xr.Dataset:
    """Return the errors of a study in the terms of the field.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result; its state has x, y and maybe z, and vx, vy and maybe vz if there is a velocity, in the axes
        that the attribute ``frame`` names (Earth-fixed ones without it).

    Returns
    -------
    xarray.Dataset, dims (estimator, trial, time)
        ``position`` [m] and ``velocity`` [m/s]: length of the error vector. Signed, estimate minus truth:
        ``height`` above the WGS-84 ellipsoid, or z in local axes [m], horizontal ``speed`` [m/s], ``course`` clockwise
        from north [deg] in [-180, 180), NaN where truth or estimate is at rest. A state without a velocity has
        ``position`` and ``height`` only, one in the plane no ``height``; inertial and launch axes (attribute
        ``frame``) have ``position`` and ``velocity`` only. Where the state has a component ``bias`` its signed error
        is there as well. What the truth does not have has no error; one that takes a component which this
        estimator does not have is NaN.
    """
    states = [str(name) for name in dataset["state"].values]
    true = set(states) if "in_truth" not in dataset.coords else {*dataset["state"].values[dataset["in_truth"].values]}
    place = [states.index(name) for name in POSITION if name in true]
    own = scored(dataset).values[:, None, None, :]
    frame = dataset.attrs.get("frame", "earth_fixed")
    local = frame == "local"
    grounded = local or frame == "earth_fixed"
    moving = [states.index(name) for name in VELOCITY if name in true]
    dims = ("estimator", "trial", "time")
    estimate = dataset["estimate"].transpose(*dims, "state").values
    truth = dataset["truth"]
    truth = truth.transpose("trial", "time", "state") if "trial" in truth.dims else truth.transpose("time", "state")
    known = np.broadcast_to(truth.values, estimate.shape)
    finite = np.isfinite(estimate)
    # A stand-in keeps the geometry free of NaN; what it gives is replaced by infinity below.
    usable = np.where(finite, estimate, known)

    def judged(error: Array, columns: list[int]) -> tuple[tuple[str, ...], Array]:
        lost = ~finite[..., columns].all(axis=-1) | ~np.isfinite(error)
        unknown = ~np.isfinite(known[..., columns]).all(axis=-1) | ~own[..., columns].all(axis=-1)
        return dims, np.where(unknown, np.nan, np.where(lost, np.inf, error))

    found = {}
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        here, there = usable[..., place], truth.values[..., place]
        apart = np.linalg.norm(here - there, axis=-1) if place else np.full(estimate.shape[:-1], np.nan)
        found["position"] = judged(apart, place) if place else (dims, apart)
        if moving:
            moved, true_moved = usable[..., moving], truth.values[..., moving]
            found["velocity"] = judged(np.linalg.norm(moved - true_moved, axis=-1), moving)
        if grounded and len(place) == 3:
            high = (here - there)[..., 2] if local else ecef_to_geodetic(here)[2] - ecef_to_geodetic(there)[2]
            found["height"] = judged(high, place)
        if grounded and (len(moving) > 1 if local else len(place) == len(moving) == 3):
            both = [*place, *moving]
            course, speed = _course_speed(here, moved, local)
            true_course, true_speed = _course_speed(there, true_moved, local)
            found["speed"] = judged(speed - true_speed, both)
            turned = judged(np.degrees(wrap(course - true_course)), both)[1]
            found["course"] = dims, np.where(np.minimum(speed, true_speed) < _AT_REST, np.nan, turned)
        if "bias" in true:
            column = [states.index("bias")]
            found["bias"] = judged((usable - known)[..., column[0]], column)
    names = {name: dataset[name] for name in dims if name in dataset.coords}
    return xr.Dataset(found, coords=names)


def _course_speed(place: Array, velocity: Array, local: bool) -> tuple[Array, Array]:
    """Return course clockwise from north [rad] and horizontal speed [m/s]."""
    if local:
        return np.arctan2(velocity[..., 0], velocity[..., 1]), np.hypot(velocity[..., 0], velocity[..., 1])
    return course_speed(place, velocity)[:2]


# ---------------------------------------------------------------------------------------------- over trials


def rmse(error: xr.DataArray) -> xr.DataArray:
    """Return the root mean square over the trials; infinite if a trial is lost, NaN where no truth is known."""
    known = error.notnull()
    total = (error**2).where(known, 0.0).sum("trial")
    count = known.sum("trial")
    return (total / count.where(count > 0)) ** 0.5


def median(error: xr.DataArray) -> xr.DataArray:
    """Return the median over the trials of the size of the error; lost trials count as infinite."""
    return percentile(error, 50.0)


def percentile(error: xr.DataArray, percent: float) -> xr.DataArray:
    """Return a percentile over the trials of the size of the error.

    Parameters
    ----------
    error : xarray.DataArray
        With the dimension ``trial``; one of `errors`.
    percent : float
        0 to 100.

    Returns
    -------
    xarray.DataArray
        Interpolated between order statistics; infinite where a lost trial takes part, NaN where no truth is known.
    """
    if not 0 <= percent <= 100:
        raise ValueError(f"percent: {percent} is not allowed; 0 to 100")
    size = abs(error).clip(max=_HUGE)  # between two infinities interpolation would give NaN
    axis = error.get_axis_num("trial")
    values = np.full([n for i, n in enumerate(error.shape) if i != axis], np.nan)
    known = np.isfinite(size.values).any(axis=axis)
    if known.any():
        moved = np.moveaxis(size.values, axis, 0)
        values[known] = np.nanpercentile(moved[:, known], percent, axis=0)
    kept = size.isel(trial=0, drop=True)
    return kept.copy(data=np.where(values > 1e-3 * _HUGE, np.inf, values))


def bias_and_spread(dataset: xr.Dataset) -> xr.Dataset:
    """Return mean and standard deviation of the error per component of the state.

    Returns
    -------
    xarray.Dataset, dims (estimator, time, state)
        ``bias`` and ``spread`` (divided by trials - 1; NaN for one trial), in the state's units. Only over trials that
        are not lost: a mean with infinities says nothing.
    """
    error = axis_errors(dataset)
    error = error.where(np.isfinite(error))
    count = error.notnull().sum("trial")
    mean = error.mean("trial")
    squares = ((error - mean) ** 2).sum("trial")
    return xr.Dataset({"bias": mean, "spread": (squares / (count - 1).where(count > 1)) ** 0.5})


# ---------------------------------------------------------------------------------------------- consistency


def chi_square_band(freedom: ArrayLike, count: ArrayLike, confidence: float = 0.95) -> tuple[Array, Array]:
    r"""Return the band in which the mean of independent chi-square variables lies.

    .. math:: \chi^2_{(1\mp c)/2}\Big(\sum_i \nu_i\Big)\Big/N

    Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 5.4.

    Parameters
    ----------
    freedom : array_like
        Sum of the degrees of freedom over the trials.
    count : array_like
        N, what the sum is divided by.
    confidence : float
        c, between 0 and 1.

    Returns
    -------
    lower, upper : ndarray
        NaN where there are no degrees of freedom.
    """
    if not 0 < confidence < 1:
        raise ValueError(f"confidence: {confidence} is not allowed; between 0 and 1")
    total, divisor = np.asarray(freedom, dtype=float), np.asarray(count, dtype=float)
    total = np.where(total > 0, total, np.nan)
    tail = (1 - confidence) / 2
    with np.errstate(invalid="ignore", divide="ignore"):
        return chi2.ppf(tail, total) / divisor, chi2.ppf(1 - tail, total) / divisor


def nees_statistics(dataset: xr.Dataset, confidence: float = 0.95) -> xr.Dataset:
    """Return the mean NEES over the trials, with the band that a consistent filter keeps.

    Parameters
    ----------
    dataset : xarray.Dataset
        With ``nees`` (estimator, trial, time).
    confidence : float
        Of the band.

    Returns
    -------
    xarray.Dataset, dims (estimator, time)
        ``mean``, ``lower``, ``upper``, ``trials``: how many have a NEES, the others are left out; ``freedom``
        (estimator): its degrees of freedom, the number of components that are `scored`.
    """
    nees = dataset["nees"].transpose("estimator", "trial", "time")
    known = nees.notnull()
    trials = known.sum("trial")
    mean = nees.where(known, 0.0).sum("trial") / trials.where(trials > 0)
    freedom = scored(dataset).sum("state")
    lower, upper = chi_square_band(trials.values * freedom.values[:, None], trials.values, confidence)
    bands = {"lower": (mean.dims, lower), "upper": (mean.dims, upper)}
    return xr.Dataset({"mean": mean, **bands, "trials": trials, "freedom": freedom})


def nis_statistics(dataset: xr.Dataset, confidence: float = 0.95) -> xr.Dataset:
    """Return the mean NIS over the trials, per degree of freedom too, with the band that a consistent filter keeps.

    Parameters
    ----------
    dataset : xarray.Dataset
        With ``nis`` and ``nis_dof`` (estimator, trial, time).
    confidence : float
        Of the band.

    Returns
    -------
    xarray.Dataset, dims (estimator, time)
        ``mean`` and ``dof_mean`` over the trials that have a NIS; ``ratio``: sum of the NIS over sum of the degrees of
        freedom, 1 for a consistent filter, with ``lower`` and ``upper``.
    """
    nis = dataset["nis"].transpose("estimator", "trial", "time")
    freedom = dataset["nis_dof"].transpose("estimator", "trial", "time")
    known = nis.notnull() & (freedom > 0)
    trials = known.sum("trial")
    total, summed = nis.where(known, 0.0).sum("trial"), freedom.where(known, 0.0).sum("trial")
    lower, upper = chi_square_band(summed.values, summed.values, confidence)
    return xr.Dataset(
        {
            "mean": total / trials.where(trials > 0),
            "dof_mean": (summed / trials.where(trials > 0)).fillna(0.0),
            "ratio": total / summed.where(summed > 0),
            "lower": (summed.dims, lower),
            "upper": (summed.dims, upper),
        }
    )


# -------------------------------------------------------------------------------------------------- scalars


def armse(curve: ArrayLike) -> float:
    """Return the average over the epochs of an RMSE curve; epochs without a known truth (NaN) are left out."""
    values = np.asarray(curve, dtype=float)
    values = values[~np.isnan(values)]
    return float(values.mean()) if values.size else math.nan


def convergence_time(time: ArrayLike, curve: ArrayLike, threshold: float | None = None, fraction: float = 0.5) -> float:
    """Return the first epoch from which an RMSE curve stays at or below a threshold, to the end.

    Parameters
    ----------
    time : array_like, shape (time,)
        Epochs [s].
    curve : array_like, shape (time,)
        RMSE; infinite where a trial is lost, NaN where there is none (such epochs do not decide).
    threshold : float, optional
        In the unit of the curve. By default `fraction` times the first value of the curve that is finite:
        estimators that start from the same fix are then held to the same threshold, and none's convergence time
        depends on who else takes part.
    fraction : float
        See `threshold`.

    Returns
    -------
    float
        Time [s]; NaN if the curve does not stay below.
    """
    t, values = np.asarray(time, dtype=float), np.asarray(curve, dtype=float)
    known = ~np.isnan(values)
    t, values = t[known], values[known]
    finite = np.isfinite(values)
    if not finite.any():
        return math.nan
    limit = fraction * values[finite][0] if threshold is None else threshold
    above = np.flatnonzero(~(values <= limit))
    first = above[-1] + 1 if above.size else 0
    return float(t[first]) if first < t.size else math.nan


def diverged(dataset: xr.Dataset, limit: float | None = None) -> xr.DataArray:
    """Return which trials have diverged: position error at the last epoch not finite, or beyond the limit.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result.
    limit : float, optional
        Position error [m]; by default the attribute ``divergence_m``.

    Returns
    -------
    xarray.DataArray of bool, dims (estimator, trial)
        The last epoch is the last one at which the trial's truth is known; a trial without any has not diverged.
    """
    return _diverged(errors(dataset)["position"], _limit(dataset, limit))


def not_started(dataset: xr.Dataset) -> xr.DataArray:
    """Return which trials never started: no epoch has a finite position, although the truth is known at some.

    Returns
    -------
    xarray.DataArray of bool, dims (estimator, trial)
        Such a trial has no error to be counted in an RMSE, as a lost one has: it is counted apart.
    """
    error = errors(dataset)["position"]
    return error.notnull().any("time") & ~(abs(error) < np.inf).any("time")


def _limit(dataset: xr.Dataset, limit: float | None) -> float:
    return float(dataset.attrs["divergence_m"] if limit is None else limit)


def _diverged(position: xr.DataArray, limit: float) -> xr.DataArray:
    known = position.notnull()
    last = known.sizes["time"] - 1 - known.isel(time=slice(None, None, -1)).argmax("time")
    return position.isel(time=last).drop_vars("time", errors="ignore") > limit


# -------------------------------------------------------------------------------------------------- summary


def summarise(dataset: xr.Dataset) -> dict[str, dict[str, Any]]:
    """Return the part ``estimators`` of ``summary.json``.

    Parameters
    ----------
    dataset : xarray.Dataset
        A study's result with the attribute ``divergence_m``, with or without bounds.

    Returns
    -------
    dict
        By estimator: lists over the epochs and scalars, as in the design's list; null (None) where a number is
        undefined or not finite. Errors are over the trials that started, also where they diverged later;
        ``not_started`` says how many never did.
    """
    # One estimator after the other: a study of many trials would not fit into memory five times.
    return {
        str(name): _summarise_one(dataset.isel(estimator=[i])) for i, name in enumerate(dataset["estimator"].values)
    }


def _summarise_one(dataset: xr.Dataset) -> dict[str, Any]:
    time = dataset["time"].values
    never = not_started(dataset)
    error = errors(dataset).where(~never)
    curves = {name: rmse(error[name]).values[0] for name in error}
    nees, nis = nees_statistics(dataset), nis_statistics(dataset)
    missing = [None] * time.size

    def curve(name: str) -> list[float | None]:
        return _plain(curves[name]) if name in curves else list(missing)

    quantities = [name for name in QUANTITIES if name != "bias" or name in curves]
    summary: dict[str, Any] = {f"rmse_{name}_{_UNITS[name]}": curve(name) for name in quantities}
    summary["median_position_m"] = _plain(median(error["position"]).values[0])
    summary["nees_mean"] = _plain(nees["mean"].values[0])
    summary["nis_mean"] = _plain(nis["mean"].values[0])
    summary["nis_dof_mean"] = _plain(nis["dof_mean"].values[0])
    for name in (bound for bound in BOUNDS if bound.rpartition("_")[2] in quantities):
        values = dataset[name].values[0] if name in dataset else np.full(time.size, np.nan)
        summary[f"{name}_{_UNITS[name.rpartition('_')[2]]}"] = _plain(values)
    name = str(dataset["estimator"].values[0])
    summary["causal"] = causal(dataset, name)
    summary["not_started"] = int(never.sum())
    summary["diverged"] = int(_diverged(error["position"], _limit(dataset, None)).sum())
    summary["armse_position_m"] = _plain(armse(curves["position"]))
    summary["convergence_time_s"] = _plain(
        convergence_time(time, curves["position"], dataset.attrs.get("convergence_m"))
    )
    return summary


def _plain(value: ArrayLike) -> Any:
    """Return Python floats, None for what JSON cannot say."""
    array = np.asarray(value, dtype=float)
    if array.ndim == 0:
        return float(array) if np.isfinite(array) else None
    return [float(item) if math.isfinite(item) else None for item in array]
