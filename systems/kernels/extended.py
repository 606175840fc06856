"""The extended and the iterated extended Kalman update of many trials, one after the other."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.calling import UPDATE
from quietfix.systems.kernels.compiling import compiled, inlined
from quietfix.systems.kernels.gains import advance, correct, least, nothing, posterior_covariance, tell, whiten_rows
from quietfix.systems.kernels.matrices import cholesky, copy
from quietfix.systems.kernels.rows import OK, evaluate, is_diagonal, mark_missing, residual, whitening

__all__ = ["RAISED", "update"]

RAISED = 3
"""Beside what `whitening` returns: a kernel raised."""


@compiled(UPDATE)
def update(
    mean: Any,
    covariance: Any,
    measurement: Any,
    platforms: Any,
    noise: Any,
    parts: Any,
    chosen: Any,
    parameters: Any,
    moduli: Any,
    settings: Any,
    space: Any,
    out_mean: Any,
    out_covariance: Any,
    innovation: Any,
    nis: Any,
    used: Any,
) -> int:
    """Update every trial; return 0, or what went wrong in which trial and part: (trial 256 + part) 16 + reason.

    Arguments as of `quietfix.systems.filters.gaussian.GaussianFilter.update`: `platforms` and `noise` hold one for all
    trials or one for each; `settings` are how many linearisations there are at most, and the step below which there is
    no more; `space` is room to work in, see `quietfix.systems.kernels.updating`. A trial whose prior is
    not finite becomes NaN.
    """
    iterations, tolerance = int(settings[0]), settings[1]
    trials, n = mean.shape
    m, full = chosen.shape[0], parts[parts.shape[0] - 1, 2]
    five, three, value, jacobian, squares, rows, weights = _rooms(space, n, m, full)
    x, there, moved, y, spare = five[0], five[1], five[2], five[3], five[4]
    difference, whitened, missing = three[0], three[1], three[2]
    root, gram, next_gram, weight = squares[0], squares[1], squares[2], weights[0]
    whole = own = False  # whether `weight` is that of noise that all trials share, without a missing row; diagonal
    for t in range(trials):
        if not cholesky(mean, covariance, t, squares[3:], root):
            nothing(t, out_mean, out_covariance, innovation, nis, used)
            continue
        seen = platforms[t if platforms.shape[0] > 1 else 0]
        copy(mean[t], x, there)
        wide, step = 0, math.inf
        for iteration in range(iterations):
            if not step > tolerance * tolerance:
                break
            failed = evaluate(parts, parameters, there, seen, value, jacobian)
            if failed >= 0:
                return (t * 256 + failed) * 16 + RAISED
            residual(t, measurement, value, chosen, moduli, difference)
            if iteration == 0:
                used[t] = count = mark_missing(difference, jacobian, chosen, missing)
                if not (whole and count == m):
                    went = whitening(t if noise.shape[0] > 1 else 0, noise, missing, weights[1], weight)
                    if went != OK:
                        return t * 4096 + went
                    whole, own = count == m and noise.shape[0] == 1, is_diagonal(weight)
                tell(t, difference, missing, innovation)
            _pull(difference, jacobian, chosen, missing, there, x)
            whiten_rows(weight, own, difference, jacobian, chosen, missing, root, whitened, rows)
            next_wide = correct(rows, whitened, next_gram, y, spare)
            if iteration == 0:
                nis[t] = least(rows, whitened, y) if count > 0 else math.nan
            step = advance(x, root, y, there, moved)
            if iteration > 0 and not math.isfinite(step):
                break  # an iterate outside of where the model is defined: such a trial stays at the one before
            there, moved, gram, next_gram, wide = moved, there, next_gram, gram, next_wide
        copy(there, out_mean[t], moved)
        posterior_covariance(t, root, gram, wide, next_gram, out_covariance)
    return 0


@inlined
def _rooms(space: Any, n: int, m: int, full: int) -> Any:
    """Return five vectors (n,), three (m,), value and Jacobian, six (n, n), (m, n) and two (m, m)."""
    a = 5 * n
    b = a + 3 * m
    c = b + full
    d = c + full * n
    e = d + 6 * n * n
    f = e + m * n
    return (
        space[:a].reshape(5, n),
        space[a:b].reshape(3, m),
        space[b:c],
        space[c:d].reshape(full, n),
        space[d:e].reshape(6, n, n),
        space[e:f].reshape(m, n),
        space[f : f + 2 * m * m].reshape(2, m, m),
    )


@inlined
def _pull(difference: Any, jacobian: Any, chosen: Any, missing: Any, here: Any, x: Any) -> None:
    """Add H (here - x) to the residual: what it would be, were the prior's mean linearised here; 0 in missing rows."""
    for i in range(difference.shape[0]):
        total = 0.0
        for k in range(x.shape[0]):
            total += jacobian[chosen[i], k] * (here[k] - x[k])
        difference[i] = 0.0 if missing[i] > 0.0 else difference[i] + total
