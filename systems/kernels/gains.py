"""The update of one trial that every Gaussian filter shares; the algebra of `quietfix.systems.filters.square_root`."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.compiling import inlined
from quietfix.systems.kernels.matrices import absorb, factor, solve_lower, solve_upper_of_lower

__all__ = ["advance", "correct", "least", "nothing", "posterior_covariance", "products", "tell", "whiten_rows"]

_WIDE = 1e8  # as in quietfix.systems.filters.square_root
_EPSILON = 2.220446049250313e-16


@inlined
def whiten_rows(
    weight: Any, own: bool, residual: Any, jacobian: Any, chosen: Any, missing: Any, root: Any, out: Any, rows: Any
) -> None:
    """Write W r (m,) and Y = W H L (m, n) for the rows that are there; W and L are lower triangular.

    `own`: W is diagonal.
    """
    m, n = rows.shape
    for i in range(m):
        for j in range(n):
            rows[i, j] = 0.0
        if missing[i] == 0.0:
            for k in range(n):
                slope = jacobian[chosen[i], k]
                if slope != 0.0:
                    for j in range(k + 1):
                        rows[i, j] += slope * root[k, j]
    for i in range(m - 1, -1, -1):  # in place: a row of W needs those up to its own
        first = i if own else 0
        total = 0.0
        for k in range(first, i + 1):
            total += weight[i, k] * residual[k]
        out[i] = total
        for j in range(n):
            total = 0.0
            for k in range(first, i + 1):
                total += weight[i, k] * rows[k, j]
            rows[i, j] = total


@inlined
def correct(rows: Any, whitened: Any, gram: Any, y: Any, spare: Any) -> int:
    r"""Write the y that minimises :math:`|r - Y y|^2 + |y|^2`, and the factor of M; return whether that is wide.

    Where M is wide, :math:`[Y; I]` is triangulated as it stands, without forming M.
    """
    m, n = rows.shape
    products(rows, gram)
    wide = 0
    for i in range(n):
        total = 0.0
        for k in range(m):
            total += rows[k, i] * whitened[k]
        y[i] = total
        gram[i, i] += 1.0
        if gram[i, i] > _WIDE:  # no element of a positive definite matrix exceeds its largest diagonal one
            wide = 1
    if wide > 0:
        for i in range(n):
            y[i] = 0.0
            for j in range(n):
                gram[i, j] = 1.0 if i == j else 0.0
        for k in range(m):
            for j in range(n):
                spare[j] = rows[k, j]
            absorb(gram, n, spare, whitened[k], y)
    else:
        if not factor(gram, n):  # only where something is not finite
            for j in range(n):
                y[j] = math.nan
            return 0
        solve_lower(gram, n, y)
    solve_upper_of_lower(gram, n, y)
    return wide


@inlined
def posterior_covariance(t: int, root: Any, gram: Any, wide: int, half: Any, covariance: Any) -> None:
    r"""Write :math:`A A^T`, :math:`A = L F^{-T}`, for the factor F in `gram`, as that of trial t; `half` is A^T."""
    n = root.shape[0]
    four = n - n % 4
    for begin in range(0, four, 4):  # four rows of A at a time: none of them waits for another
        _four_rows(root, gram, half, begin)
    for i in range(four, n):
        for j in range(n):
            total = root[i, j]
            for k in range(j):
                total -= gram[j, k] * half[k, i]
            half[j, i] = total / gram[j, j]
    products(half, covariance[t])
    for i in range(n):
        if wide > 0:
            covariance[t, i, i] += n * n * _EPSILON * covariance[t, i, i]
        for j in range(i):
            covariance[t, j, i] = covariance[t, i, j]


@inlined
def _four_rows(root: Any, gram: Any, half: Any, i: int) -> None:
    """Write four rows of L F^-T, from row i on, as columns."""
    for j in range(root.shape[0]):
        a, b, c, d = root[i, j], root[i + 1, j], root[i + 2, j], root[i + 3, j]
        for k in range(j):
            shared = gram[j, k]
            a -= shared * half[k, i]
            b -= shared * half[k, i + 1]
            c -= shared * half[k, i + 2]
            d -= shared * half[k, i + 3]
        pivot = gram[j, j]
        half[j, i], half[j, i + 1], half[j, i + 2], half[j, i + 3] = a / pivot, b / pivot, c / pivot, d / pivot


@inlined
def products(rows: Any, out: Any) -> None:
    """Write the lower triangle of Y^T Y (n, n) for rows Y (m, n), and some of the upper one, which means nothing."""
    m, n = rows.shape
    four = n - n % 4
    for j in range(0, four, 4):
        for i in range(j, n):
            a = b = c = d = 0.0
            for k in range(m):
                shared = rows[k, i]
                a += shared * rows[k, j]
                b += shared * rows[k, j + 1]
                c += shared * rows[k, j + 2]
                d += shared * rows[k, j + 3]
            out[i, j], out[i, j + 1], out[i, j + 2], out[i, j + 3] = a, b, c, d
    for j in range(four, n):
        for i in range(j, n):
            total = 0.0
            for k in range(m):
                total += rows[k, i] * rows[k, j]
            out[i, j] = total


@inlined
def tell(t: int, difference: Any, missing: Any, innovation: Any) -> None:
    """Write the innovation of trial t; NaN in missing rows."""
    for i in range(difference.shape[0]):
        innovation[t, i] = math.nan if missing[i] > 0.0 else difference[i]


@inlined
def nothing(t: int, mean: Any, covariance: Any, innovation: Any, nis: Any, used: Any) -> None:
    """Write NaN for a trial whose prior is not finite."""
    nis[t], used[t] = math.nan, 0.0
    for i in range(mean.shape[1]):
        mean[t, i] = math.nan
        for j in range(mean.shape[1]):
            covariance[t, i, j] = math.nan
    for i in range(innovation.shape[1]):
        innovation[t, i] = math.nan


@inlined
def least(rows: Any, whitened: Any, y: Any) -> float:
    """Return |r - Y y|^2 + |y|^2: the normalised innovation squared."""
    total, more = 0.0, 0.0
    for i in range(rows.shape[0]):
        left = whitened[i]
        predicted = 0.0
        for j in range(rows.shape[1]):
            predicted += rows[i, j] * y[j]
        left -= predicted
        total += left * left
    for j in range(rows.shape[1]):
        more += y[j] * y[j]
    return total + more


@inlined
def advance(mean: Any, root: Any, y: Any, here: Any, out: Any) -> float:
    """Write mean + L y; return the squared distance from `here`."""
    square = 0.0
    for i in range(mean.shape[0]):
        total = 0.0
        for k in range(i + 1):
            total += root[i, k] * y[k]
        out[i] = mean[i] + total
        square += (out[i] - here[i]) * (out[i] - here[i])
    return square
