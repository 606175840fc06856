"""The normalised estimation error squared of many trials, one after the other."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.compiling import compiled, inlined

__all__ = ["normalised"]

_UNEVEN = 1e-24  # (1e-12)^2: one triangle then says what the whole matrix does


@inlined
def _solved(t: int, error: Any, covariance: Any, places: Any, lower: Any, scaled: Any) -> float:
    """Return the error of trial t, NaN or infinity where the matrix is not finite, positive definite and symmetric.

    Units need no scaling: what L D L' rounds does not depend on that of rows and columns (Higham, *Accuracy and
    Stability of Numerical Algorithms*, ch. 10).
    """
    total = 0.0
    for i in range(places.shape[0]):
        row = places[i]
        left, pivot = error[t, i], covariance[t, row, row]
        size = _UNEVEN * pivot
        for j in range(i):
            column = places[j]
            one = covariance[t, row, column]
            uneven = one - covariance[t, column, row]
            if not uneven * uneven <= size * covariance[t, column, column]:
                return math.nan
            for k in range(j):
                one -= scaled[1, k] * lower[j, k]
            scaled[1, j] = one
            slope = one * scaled[2, j]
            lower[i, j] = slope
            pivot -= one * slope
            left -= slope * scaled[0, j]
        if not pivot > 0.0:
            return math.nan
        scaled[0, i], scaled[2, i] = left, 1.0 / pivot
        total += left * left * scaled[2, i]
    return total


@compiled("int64(float64[:,::1],float64[:,:,::1],int64[::1],float64[:,::1],float64[::1])")
def normalised(error: Any, covariance: Any, places: Any, work: Any, out: Any) -> int:
    r"""Write :math:`e^T P^{-1} e = \sum_i z_i^2 / d_i` with :math:`P = L\,\mathrm{diag}(d)\,L^T` and :math:`L z = e`.

    `error` (trials, k), `covariance` (trials, n, n), whose `places` (k,) are those of the error; `work` is (k + 3, k).
    A trial with a number that is not finite, or a variance not above 0, gives NaN; one whose covariance is not positive
    definite or not symmetric infinity. Returns 0.
    """
    k = places.shape[0]
    for t in range(error.shape[0]):
        total = _solved(t, error, covariance, places, work[3:], work[:3])
        if total - total != 0.0:
            good, nought = True, 0.0
            for i in range(k):
                good = good and covariance[t, places[i], places[i]] > 0.0
                nought += error[t, i] - error[t, i]
                for j in range(k):
                    nought += covariance[t, places[i], places[j]] - covariance[t, places[i], places[j]]
            total = math.inf if good and nought == 0.0 else math.nan
        out[t] = total
    return 0
