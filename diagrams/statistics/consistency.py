"""Whether a filter's own covariance can be believed: NEES and NIS, and the bands in which they must lie."""

from __future__ import annotations

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.stats import chi2

from quietfix.diagrams.statistics.epochs import along
from quietfix.diagrams.statistics.state_errors import scored

__all__ = ["chi_square_band", "nees_statistics", "nis_statistics"]

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
    nees = dataset["nees"].transpose("estimator", "trial", along(dataset))
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
    nis = dataset["nis"].transpose("estimator", "trial", along(dataset))
    freedom = dataset["nis_dof"].transpose("estimator", "trial", along(dataset))
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
