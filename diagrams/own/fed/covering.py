"""Whether the sigmas that are claimed cover the residuals of a run on recorded measurements.

The first epoch does not count: what is known before it is often so little that a measurement is no linear function of
it, and its NIS then is no chi-square whatever the measurements are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.stats import chi2

from quietfix.diagrams.console.tables import three_digits

__all__ = ["Covering", "Residual", "judge", "residuals_of"]

Array = NDArray[np.float64]

_TAIL = 1e-4  # chance that residuals as believed give a sum of the NIS beyond its limits, on either side
_LARGER = 1.5  # times as large as believed


@dataclass(frozen=True)
class Residual:
    """The innovations of one row: their root mean square, and the standard deviation that is claimed for it."""

    row: str
    unit: str
    rms: float
    claimed: float


@dataclass(frozen=True)
class Covering:
    """What the normalised innovations say of what is claimed.

    Attributes
    ----------
    nis : float
        Their sum over its degrees of freedom; NaN: there is none.
    low, high : float
        Between what it lies, but for a chance of `_TAIL` on either side, if the residuals are as they are believed.
    excess, epochs : int
        In how many of all epochs that were used lies what is too much: without those of the largest NIS it would lie
        below `high`.
    worst : float
        Time of the largest NIS per degree of freedom [s].
    residual : Residual or None
        The row whose residuals are largest against what is claimed for it.
    """

    nis: float
    low: float
    high: float
    excess: int
    epochs: int
    worst: float
    residual: Residual | None

    def said(self, target: str, estimator: str, larger: float | None) -> str:
        """Return it in words; empty: it is covered, and not more than that."""
        if self.nis < self.low:
            return (
                f"{target}the residuals of {estimator} are smaller than is claimed (NIS/dof {three_digits(self.nis)}, "
                f"chance gives at least {three_digits(self.low)}): sigmas {np.sqrt(self.nis):.2g} times as large would "
                "do, and its ± are wider than they need be"
            )
        if not self.nis > self.high:
            return ""
        rows = ""
        if self.residual is not None:
            unit, claimed, rms = self.residual.unit, self.residual.claimed, self.residual.rms
            rows = f" ({self.residual.row}: {three_digits(rms)} {unit} rms, {three_digits(claimed)} {unit} claimed)"
        head = f"{target}the claimed sigmas cannot cover the residuals of {estimator}"
        if larger is not None and larger > _LARGER:
            times = f"{larger:.2g} times as large"
            return (
                f"{head}, which are {times} as it believes{rows}: its ± are too small. If it is the measurements, "
                f"sigmas {times} cover them; else it is how the target moves, its start, or the platforms"
            )
        return (
            f"{head}{rows}: NIS/dof {three_digits(self.nis)}, chance gives at most {three_digits(self.high)}; what is "
            f"too much is in {self.excess} of {self.epochs} epochs, the worst at {self.worst:.6g} s: gross errors, a "
            "start that is off, or a part of the run in which something is not as believed; its ± are too small"
        )

    def summary(self) -> dict[str, Any]:
        """Return it as numbers."""
        return {
            "covered": None if np.isnan(self.nis) else bool(self.nis <= self.high),
            "worst_row": None if self.residual is None else self.residual.row,
            "worst_row_rms": None if self.residual is None else self.residual.rms,
            "worst_row_claimed": None if self.residual is None else self.residual.claimed,
        }


def residuals_of(one: xr.Dataset, claimed: Mapping[str, float]) -> list[Residual]:
    """Return the residuals of each row of an estimator that a sigma is claimed for."""
    if "innovation" not in one:
        return []
    found = []
    units = one["innovation_row_units"].values if "innovation_row_units" in one.coords else None
    for i, row in enumerate(one["innovation_row"].values):
        values = one["innovation"].isel(innovation_row=i).values
        values = values[np.isfinite(values)][1:]
        if str(row) in claimed and values.size:
            unit = "" if units is None else str(units[i])
            found.append(Residual(str(row), unit, float(np.sqrt(np.mean(np.square(values)))), claimed[str(row)]))
    return found


def judge(nis: Array, freedom: Array, time: Array, residuals: list[Residual]) -> Covering:
    """Return what they say.

    Parameters
    ----------
    nis, freedom, time : ndarray, shape (epochs,)
        Of the epochs whose measurement was used.
    residuals : list of Residual
    """
    nis, freedom, time = nis[1:], freedom[1:], time[1:]
    total = float(freedom.sum())
    if not total:
        return Covering(np.nan, np.nan, np.nan, 0, 0, np.nan, None)
    order = np.argsort(-nis / freedom)
    left = nis.sum() - np.concatenate([[0.0], np.cumsum(nis[order])])
    rest = total - np.concatenate([[0.0], np.cumsum(freedom[order])])
    limits = chi2.isf(_TAIL, np.maximum(rest, 1e-9))
    excess = int(np.argmax(left <= np.where(rest > 0, limits, np.inf)))
    worst = max(residuals, key=lambda one: one.rms / one.claimed, default=None)
    return Covering(
        float(nis.sum() / total),
        float(chi2.ppf(_TAIL, total) / total),
        float(limits[0] / total),
        excess,
        nis.size,
        float(time[order[0]]),
        worst,
    )
