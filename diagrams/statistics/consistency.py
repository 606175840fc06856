"""Whether a filter's own covariance can be believed: NEES and NIS, and the bands in which they must lie."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2

from quietfix.diagrams.statistics.epochs import along
from quietfix.diagrams.statistics.state_errors import scored

__all__ = ["chi_square_band", "consistency_sums", "nees_statistics", "nis_statistics"]

Array = NDArray[np.float64]


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


def nees_statistics(
    dataset: xr.Dataset, confidence: float = 0.95, sums: Mapping[str, Array] | None = None
) -> xr.Dataset:
    """Return the mean NEES over the trials, with the band that a consistent filter keeps.

    Parameters
    ----------
    dataset : xarray.Dataset
        With ``nees`` (estimator, trial, time).
    confidence : float
        Of the band.
    sums : mapping, optional
        Those over the trials, see `quietfix.diagrams.statistics.tally.Tally`, where they are known already.

    Returns
    -------
    xarray.Dataset, dims (estimator, time)
        ``mean``, ``lower``, ``upper``, ``trials``: how many have a NEES, the others are left out; ``freedom``
        (estimator): its degrees of freedom, the number of components that are `scored`.
    """
    given = consistency_sums(dataset, ("nees",)) if sums is None else sums
    total, trials = _curves(dataset, given, "nees", "nees_known")
    mean = total / trials.where(trials > 0)
    freedom = scored(dataset).sum("state")
    lower, upper = chi_square_band(trials.values * freedom.values[:, None], trials.values, confidence)
    bands = {"lower": (mean.dims, lower), "upper": (mean.dims, upper)}
    return xr.Dataset({"mean": mean, **bands, "trials": trials, "freedom": freedom})


def nis_statistics(
    dataset: xr.Dataset, confidence: float = 0.95, sums: Mapping[str, Array] | None = None
) -> xr.Dataset:
    """Return the mean NIS over the trials, per degree of freedom too, with the band that a consistent filter keeps.

    Parameters
    ----------
    dataset : xarray.Dataset
        With ``nis`` and ``nis_dof`` (estimator, trial, time).
    confidence : float
        Of the band.
    sums : mapping, optional
        Those over the trials, see `quietfix.diagrams.statistics.tally.Tally`, where they are known already.

    Returns
    -------
    xarray.Dataset, dims (estimator, time)
        ``mean`` and ``dof_mean`` over the trials that have a NIS; ``ratio``: sum of the NIS over sum of the degrees of
        freedom, 1 for a consistent filter, with ``lower`` and ``upper``.
    """
    given = consistency_sums(dataset, ("nis",)) if sums is None else sums
    total, summed, trials = _curves(dataset, given, "nis", "nis_dof", "nis_known")
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


def consistency_sums(dataset: xr.Dataset, kinds: Collection[str] = ("nees", "nis")) -> dict[str, Array]:
    """Return sums over the trials (estimator, time): ``nees``, ``nis`` and ``nis_dof``, and how many trials have one.

    Parameters
    ----------
    dataset : xarray.Dataset
        With ``nees``, or ``nis`` and ``nis_dof``, (estimator, trial, time).
    kinds : collection of {'nees', 'nis'}
        Which are wanted.
    """
    dims = ("estimator", "trial", along(dataset))
    found: dict[str, xr.DataArray] = {}
    if "nees" in kinds:
        nees = dataset["nees"].transpose(*dims)
        known = nees.notnull()
        found |= {"nees": nees.where(known, 0.0), "nees_known": known}
    if "nis" in kinds:
        nis, freedom = dataset["nis"].transpose(*dims), dataset["nis_dof"].transpose(*dims)
        known = nis.notnull() & (freedom > 0)
        found |= {"nis": nis.where(known, 0.0), "nis_dof": freedom.where(known, 0.0), "nis_known": known}
    return {name: np.asarray(values.sum("trial").values, dtype=float) for name, values in found.items()}


def _curves(dataset: xr.Dataset, sums: Mapping[str, Array], *names: str) -> list[xr.DataArray]:
    axis = along(dataset)
    coordinates = {name: dataset[name] for name in ("estimator", axis) if name in dataset.coords}
    return [xr.DataArray(sums[name], coordinates, ("estimator", axis)) for name in names]
