"""The rows of one measurement: values and derivatives from the kernels, residuals, missing rows, whitening."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.calling import call_kernel
from quietfix.systems.kernels.compiling import inlined
from quietfix.systems.kernels.matrices import factor

__all__ = ["GAP", "INDEFINITE", "OK", "evaluate", "is_diagonal", "mark_missing", "residual", "whitening", "wrapped"]

OK, GAP, INDEFINITE = 0, 1, 2
"""What `whitening` returns: done; a row that is there has no finite covariance; the noise is not positive definite."""


@inlined
def evaluate(parts: Any, parameters: Any, state: Any, platforms: Any, value: Any, jacobian: Any) -> int:
    """Call every part's kernel; return the number of the part that raised, or -1.

    `parts` (k, 5) holds address, first row and row behind the last, first parameter and parameter behind the last.
    `jacobian` without a row asks for values alone.
    """
    for i in range(value.shape[0]):
        value[i] = 0.0
    wanted = jacobian.shape[0]
    for i in range(wanted):
        for j in range(jacobian.shape[1]):
            jacobian[i, j] = 0.0
    for k in range(parts.shape[0]):
        begin, end = parts[k, 1], parts[k, 2]
        own = jacobian[begin:end] if wanted > 0 else jacobian
        if call_kernel(parts[k, 0], state, platforms, parameters[parts[k, 3] : parts[k, 4]], value[begin:end], own):
            return k
    return -1


@inlined
def wrapped(difference: float, modulus: float) -> float:
    """Return the difference in [-modulus/2, modulus/2); modulus 0: as it is."""
    if modulus == 0.0:
        return difference
    half = 0.5 * modulus
    return (difference + half) % modulus - half


@inlined
def residual(t: int, measured: Any, value: Any, chosen: Any, moduli: Any, out: Any) -> None:
    """Write measured (trials, m) of trial t minus predicted; `chosen` says which row of `value` each one is."""
    for i in range(chosen.shape[0]):
        out[i] = wrapped(measured[t, i] - value[chosen[i]], moduli[i])


@inlined
def mark_missing(difference: Any, jacobian: Any, chosen: Any, missing: Any) -> int:
    """Write 1 where a row is not finite, else 0; return how many are there."""
    used = 0
    for i in range(chosen.shape[0]):
        nought = difference[i] - difference[i]  # NaN where one is not finite
        for j in range(jacobian.shape[1]):
            nought += jacobian[chosen[i], j] - jacobian[chosen[i], j]
        there = nought == 0.0
        missing[i] = 0.0 if there else 1.0
        used += there
    return used


@inlined
def is_diagonal(lower: Any) -> bool:
    """Return whether a lower triangular matrix is diagonal: that of rows which are independent, as they mostly are."""
    for i in range(lower.shape[0]):
        for j in range(i):
            if lower[i, j] != 0.0:
                return False
    return True


@inlined
def whitening(t: int, noise: Any, missing: Any, work: Any, weight: Any) -> int:
    r"""Write the lower triangular W with :math:`W R W^T = I` over the rows that are there; return how it went.

    As `quietfix.systems.filters.whitening.Whitener`: the correlation matrix of those rows is factored, with unit rows
    in the gaps.
    """
    m = noise.shape[1]
    for i in range(m):
        for j in range(i + 1):
            if missing[i] + missing[j] > 0.0:
                work[i, j] = 1.0 if i == j else 0.0
                continue
            if not math.isfinite(noise[t, i, j]):
                return GAP
            if not noise[t, i, i] > 0.0:
                return INDEFINITE
            work[i, j] = noise[t, i, j] * ((1.0 / math.sqrt(noise[t, i, i])) * (1.0 / math.sqrt(noise[t, j, j])))
    if not factor(work, m):
        return INDEFINITE
    for j in range(m):
        for i in range(j):
            weight[i, j] = 0.0
        weight[j, j] = 1.0 / work[j, j]
        for i in range(j + 1, m):
            total = 0.0
            for k in range(j, i):
                total -= work[i, k] * weight[k, j]
            weight[i, j] = total / work[i, i]
    for i in range(m):
        for j in range(i + 1):
            weight[i, j] = 0.0 if missing[i] + missing[j] > 0.0 else weight[i, j] * (1.0 / math.sqrt(noise[t, j, j]))
    return OK
