"""Small dense matrices of one trial: loops, because a call of LAPACK costs more than the work."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.compiling import inlined

__all__ = ["absorb", "cholesky", "copy", "factor", "repair", "solve_lower", "solve_upper_of_lower", "times"]

_SMALLEST_EIGENVALUE = 1e-12  # as in quietfix.systems.linear_algebra
_TINY = 2.2250738585072014e-308
_SWEEPS = 60


@inlined
def copy(vector: Any, one: Any, other: Any) -> None:
    """Write the elements of a vector into two others."""
    for i in range(one.shape[0]):
        one[i] = other[i] = vector[i]


@inlined
def factor(matrix: Any, n: int) -> bool:
    """Replace the lower triangle by its Cholesky factor, and the upper by zeros; return False where there is none."""
    for j in range(n):
        total = matrix[j, j]
        for k in range(j):
            total -= matrix[j, k] * matrix[j, k]
        if not total > 0.0:
            return False
        pivot = math.sqrt(total)
        matrix[j, j] = pivot
        for i in range(j + 1, n):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = total / pivot
        for i in range(j):
            matrix[i, j] = 0.0
    return True


@inlined
def cholesky(mean: Any, covariance: Any, t: int, work: Any, root: Any) -> bool:
    """Write the factor of the covariance of trial t into `root`; return False where a belief is not finite.

    One that is not positive definite to rounding is repaired as `quietfix.systems.linear_algebra.cholesky` says.
    `work` is (3, n, n).
    """
    n = mean.shape[1]
    finite = True
    for i in range(n):
        nought = mean[t, i] - mean[t, i]  # NaN where one is not finite
        for j in range(n):
            nought += covariance[t, i, j] - covariance[t, i, j]
            root[i, j] = covariance[t, i, j]
        finite = finite and nought == 0.0
    if finite and not factor(root, n):
        for i in range(n):
            for j in range(n):
                work[0, i, j] = covariance[t, i, j]
        repair(work, n, root)
    return finite


@inlined
def repair(work: Any, n: int, root: Any) -> None:
    """Write the factor of a matrix, `work[0]` of (3, n, n), that is not positive definite to rounding.

    The eigenvalues of its correlation matrix are raised to the smallest allowed, and the square root is triangulated.
    """
    matrix, correlation, tall = work[0], work[1], work[2]
    vectors = root
    for i in range(n):
        scale_i = math.sqrt(max(matrix[i, i], _TINY))
        for j in range(n):
            scale_j = math.sqrt(max(matrix[j, j], _TINY))
            correlation[i, j] = 0.5 * (matrix[i, j] + matrix[j, i]) / (scale_i * scale_j)
    _jacobi(correlation, n, vectors)
    for k in range(n):  # of V D V^T, a row of D^1/2 V^T after the other
        size = math.sqrt(max(correlation[k, k], _SMALLEST_EIGENVALUE))
        for i in range(n):
            tall[k, i] = vectors[i, k] * size
    for i in range(n):
        for j in range(n):
            correlation[i, j] = 0.0
    for k in range(n):
        absorb(correlation, n, tall[k], 0.0, tall[k])
    for i in range(n):
        scale = math.sqrt(max(matrix[i, i], _TINY))
        for j in range(n):
            root[i, j] = scale * correlation[i, j] if j <= i else 0.0


@inlined
def absorb(lower: Any, n: int, row: Any, right: float, y: Any) -> None:
    r"""Add a row to a triangular least squares problem, which uses the row up.

    Givens rotations make :math:`L^T` of :math:`[L^T; row]`, with a diagonal >= 0, and turn the right-hand side
    :math:`[y; right]` along (Golub and Van Loan, section 5.1.8).
    """
    for j in range(n):
        if row[j] == 0.0:
            continue
        size = math.sqrt(lower[j, j] * lower[j, j] + row[j] * row[j])
        c, s = lower[j, j] / size, row[j] / size
        for k in range(j, n):
            a, b = lower[k, j], row[k]
            lower[k, j], row[k] = c * a + s * b, c * b - s * a
        y[j], right = c * y[j] + s * right, c * right - s * y[j]


@inlined
def _jacobi(matrix: Any, n: int, vectors: Any) -> None:
    """Diagonalise a symmetric matrix by Jacobi's rotations (Golub and Van Loan, section 8.5)."""
    for i in range(n):
        for j in range(n):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(_SWEEPS):
        off = 0.0
        for p in range(n - 1):
            for q in range(p + 1, n):
                if matrix[p, q] == 0.0:
                    continue
                off = max(off, abs(matrix[p, q]))
                theta = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
                t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    t = -t
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                for k in range(n):
                    a, b = matrix[k, p], matrix[k, q]
                    matrix[k, p], matrix[k, q] = c * a - s * b, s * a + c * b
                    a, b = vectors[k, p], vectors[k, q]
                    vectors[k, p], vectors[k, q] = c * a - s * b, s * a + c * b
                for k in range(n):
                    a, b = matrix[p, k], matrix[q, k]
                    matrix[p, k], matrix[q, k] = c * a - s * b, s * a + c * b
        if off <= 1e-16:  # of a correlation matrix
            return


@inlined
def solve_lower(lower: Any, n: int, right: Any) -> None:
    """Replace the vector b by the x with L x = b."""
    for i in range(n):
        total = right[i]
        for k in range(i):
            total -= lower[i, k] * right[k]
        right[i] = total / lower[i, i]


@inlined
def solve_upper_of_lower(lower: Any, n: int, right: Any) -> None:
    """Replace the vector b by the x with L^T x = b."""
    for i in range(n - 1, -1, -1):
        total = right[i]
        for k in range(i + 1, n):
            total -= lower[k, i] * right[k]
        right[i] = total / lower[i, i]


@inlined
def times(left: Any, right: Any, out: Any) -> None:
    """Write the product of two square matrices: four columns at a time, of which none waits for another.

    At these sizes the zeros of the left one cost less than looking for them.
    """
    n = left.shape[0]
    four = n - n % 4
    for i in range(n):
        for j in range(0, four, 4):
            a = b = c = d = 0.0
            for k in range(n):
                shared = left[i, k]
                a += shared * right[k, j]
                b += shared * right[k, j + 1]
                c += shared * right[k, j + 2]
                d += shared * right[k, j + 3]
            out[i, j], out[i, j + 1], out[i, j + 2], out[i, j + 3] = a, b, c, d
        for j in range(four, n):
            total = 0.0
            for k in range(n):
                total += left[i, k] * right[k, j]
            out[i, j] = total
