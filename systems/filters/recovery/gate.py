r"""A gate for measurements that opens again where it has locked the target out.

Refused is what the prediction makes improbable: with the innovation :math:`\nu` and :math:`S = H P H^T + R`, a row
where :math:`\nu_i^2 / S_{ii}`, or an epoch where :math:`\nu^T S^{-1} \nu`, lies beyond the chi-square quantile of the
probability (Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section
5.4). A filter that is wrong itself would refuse for ever what is right. So the gate opens after K refusals one after
the other: the prediction's covariance is scaled to what the last of them says of it, and the next measurement passes.
(That one, and not the last refused: if the gate should have stayed shut, the refused one is a gross error for certain,
the next one hardly ever.) For one row with
:math:`\nu_i \sim N(0, \lambda\,(H P H^T)_{ii} + R_{ii})` the likelihood is greatest at

.. math:: \hat\lambda_i = \max\left(1, \frac{\nu_i^2 - R_{ii}}{(H P H^T)_{ii}}\right),

(the one-step fading factor of Xia, Rao, Ying and Shen, *Adaptive fading Kalman filter with an application*, Automatica
30 (1994) 1333-1338); of several rows the largest holds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from quietfix.systems.documented import choice, count, number
from quietfix.systems.filters.recovery.screening import Screened
from quietfix.systems.linear_algebra import quadratic

__all__ = ["Gate", "likeliest_scale", "normalised"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LARGEST_SCALE = 1e6  # of a covariance in one step: a thousand sigma; beyond, the gate opens once more
_TELLS = 1e-9  # a row tells of the belief's size where this share of its noise's variance comes from there


@dataclass(frozen=True)
class Gate:
    """A gate before the update: rows or epochs that the prediction makes improbable are left out, for a while.

    Parameters
    ----------
    probability : float
        That a sound row (or epoch) passes; 1 refuses nothing.
    per : {'row', 'epoch'}
        What is tested: each row by its own variance, or all rows of an epoch together.
    release_after : int
        After so many refusals one after the other the gate opens.
    """

    probability: float = number("probability that a sound row or epoch passes; 1: all", 0.999, above=0, at_most=1)
    per: str = choice(
        "what is tested: row, each by its own variance; epoch, all rows together", "row", ("row", "epoch")
    )
    release_after: int = count("the gate opens after so many refusals one after the other", 5)

    def __post_init__(self) -> None:
        """Check the arguments."""
        if not 0 < self.probability <= 1:
            raise ValueError(f"probability: {self.probability} is not allowed; > 0 and <= 1")
        if self.per not in ("row", "epoch"):
            raise ValueError(f"per: {self.per} is not allowed; one of row, epoch")
        if self.release_after < 1:
            raise ValueError(f"release_after: {self.release_after} is not allowed; a whole number >= 1")

    def width(self, rows: int) -> int:
        """Return how many tests there are of so many rows."""
        return rows if self.per == "row" else 1

    def refused(self, seen: Screened, nis: Array, rows: Array) -> tuple[Mask, Mask]:
        """Return what is refused and what was there to be tested, shape (trials, `width`).

        Parameters
        ----------
        seen : Screened
            Of the prediction.
        nis, rows : ndarray, shape (trials,)
            Normalised innovation squared over all rows that are there, and their number; see `normalised`.
        """
        if self.per == "row":
            there = np.isfinite(seen.innovation)
            ratio = np.where(there, seen.innovation, 0.0) ** 2
            spread = np.where(there, seen.own_variances + seen.noise_variances, 1.0)
            return there & (ratio > self.limit(1) * spread), there
        return self.improbable(nis, rows)[:, None], (rows > 0)[:, None]

    def limit(self, rows: int) -> float:
        """Return the largest normalised innovation squared over so many rows that passes."""
        return float(_limits(self.probability, rows)[rows])

    def improbable(self, nis: Array, rows: Array) -> Mask:
        """Return which normalised innovations squared (trials,) over so many rows are refused as a whole."""
        limits = _limits(self.probability, int(rows.max(initial=0)))
        found: Mask = nis > limits[rows.astype(int)]
        return found


@lru_cache
def _limits(probability: float, rows: int) -> Array:
    """Return the quantiles for 0 to `rows` degrees of freedom; nothing exceeds that for 0."""
    limits: Array = chi2.ppf(probability, np.arange(rows + 1))
    limits[0] = np.inf
    return limits


def normalised(seen: Screened) -> tuple[Array, Array]:
    """Return the normalised innovation squared over the rows that are there, 0 without one, and their number."""
    value, rows, _ = quadratic(seen.innovation, seen.spread)
    return value, rows


def likeliest_scale(seen: Screened, rows: Mask) -> Array:
    """Return the factor of the prediction's covariance that the marked rows (trials, m) make likeliest, >= 1."""
    own, noise = seen.own_variances, seen.noise_variances
    tells = rows & np.isfinite(seen.innovation) & (own > _TELLS * noise)
    excess = np.where(tells, seen.innovation**2 - noise, 0.0)
    scale = (excess / np.where(tells, own, 1.0)).max(axis=-1)
    return np.clip(scale, 1.0, _LARGEST_SCALE)
