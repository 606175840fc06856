"""The unscented Kalman update of many trials, one after the other; `quietfix.systems.filters.unscented` derives it."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.calling import UPDATE
from quietfix.systems.kernels.compiling import compiled, inlined
from quietfix.systems.kernels.extended import RAISED
from quietfix.systems.kernels.gains import advance, correct, least, nothing, posterior_covariance, products, tell
from quietfix.systems.kernels.matrices import cholesky, factor, repair
from quietfix.systems.kernels.particles.loops import call_over
from quietfix.systems.kernels.rows import OK, is_diagonal, whitening, wrapped

__all__ = ["update"]


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
    """Update every trial; arguments and what is returned as of `quietfix.systems.kernels.extended.update`.

    `settings` are how many columns of the root a sigma point lies off, the weight of an outer point, and that of the
    middle one in a covariance; `space` is room to work in, see `quietfix.systems.kernels.unscented.calls`.
    """
    c, weight, centre = settings[0], settings[1], settings[2]
    trials, n = mean.shape
    m, full = chosen.shape[0], parts[parts.shape[0] - 1, 2]
    vectors, rows_of_m, points, values, squares, of_points, small = _rooms(space, n, m, full)
    y, spare = vectors[0], vectors[1]
    nu, shift, missing, whitened, bend = rows_of_m[0], rows_of_m[1], rows_of_m[2], rows_of_m[3], rows_of_m[4]
    root, gram = squares[0], squares[1]
    odd, even, rows = of_points[0].reshape(m, n), of_points[1], of_points[2].reshape(m, n)
    w, omega, inflated = small[0], small[1], small[2]
    whole = False  # whether `w` is that of noise that all trials share, without a missing row
    for t in range(trials):
        if not cholesky(mean, covariance, t, squares[1:], root):
            nothing(t, out_mean, out_covariance, innovation, nis, used)
            continue
        seen = platforms[t if platforms.shape[0] > 1 else 0]
        _draw(mean[t], root, c, points)
        for k in range(parts.shape[0]):
            given = parameters[parts[k, 3] : parts[k, 4]]
            if call_over(parts[k, 5], points, 0, 2 * n + 1, seen, given, values, parts[k, 1], 0):
                return (t * 256 + k) * 16 + RAISED
        _differences(values, chosen, moduli, c, weight, odd, even, shift)
        count = _innovation(t, measurement, values, chosen, moduli, odd, even, shift, nu, missing)
        if not (whole and count == m):
            went = whitening(t if noise.shape[0] > 1 else 0, noise, missing, omega, w)
            if went != OK:
                return t * 4096 + went
            whole = count == m and noise.shape[0] == 1
        tell(t, nu, missing, innovation)
        _inflation(even, shift, w, weight, centre, bend, omega)
        _whiten(omega, w, small[3:], inflated, nu, odd, whitened, rows)
        wide = correct(rows, whitened, gram, y, spare)
        nis[t] = least(rows, whitened, y) if count > 0 else math.nan
        used[t] = count
        advance(mean[t], root, y, mean[t], out_mean[t])
        posterior_covariance(t, root, gram, wide, squares[2], out_covariance)
    return 0


@inlined
def _rooms(space: Any, n: int, m: int, full: int) -> Any:
    """Return two vectors (n,), five (m,), points and their values, four (n, n), three (n, m) and six (m, m)."""
    count = 2 * n + 1
    a = 2 * n
    b = a + 5 * m
    g = b + count * n
    d = g + count * full
    e = d + 4 * n * n
    f = e + 3 * n * m
    return (
        space[:a].reshape(2, n),
        space[a:b].reshape(5, m),
        space[b:g].reshape(n, count),
        space[g:d].reshape(full, count),
        space[d:e].reshape(4, n, n),
        space[e:f].reshape(3, n, m),
        space[f : f + 6 * m * m].reshape(6, m, m),
    )


@inlined
def _draw(mean: Any, root: Any, c: float, points: Any) -> None:
    """Write the mean x, all x + c L e and all x - c L e, side by side, (n, 2 n + 1)."""
    n = mean.shape[0]
    for i in range(n):
        here = mean[i]
        points[i, 0] = here
        for k in range(i + 1):
            points[i, 1 + k], points[i, 1 + n + k] = here + c * root[i, k], here - c * root[i, k]
        for k in range(i + 1, n):  # the columns to come are zero above their diagonal
            points[i, 1 + k] = points[i, 1 + n + k] = here


@inlined
def _differences(
    values: Any, chosen: Any, moduli: Any, c: float, weight: float, odd: Any, even: Any, shift: Any
) -> None:
    """Write the odd (m, n) and the even parts (n, m) of h(x +- c L e) - h(x), and the mean of h less h(x)."""
    m, n = odd.shape
    for i in range(m):
        row, modulus = values[chosen[i]], moduli[i]
        middle, total = row[0], 0.0
        for k in range(n):
            plus, minus = wrapped(row[1 + k] - middle, modulus), wrapped(row[1 + n + k] - middle, modulus)
            odd[i, k] = (plus - minus) / (2.0 * c)
            bend = 0.5 * (plus + minus)
            even[k, i] = bend
            total += bend
        shift[i] = total * (2.0 * weight)


@inlined
def _innovation(
    t: int,
    measured: Any,
    values: Any,
    chosen: Any,
    moduli: Any,
    odd: Any,
    even: Any,
    shift: Any,
    nu: Any,
    missing: Any,
) -> int:
    """Write the innovation, 0 with all that belongs to a row that is missing; return how many are there."""
    m, n = odd.shape
    count = 0
    for i in range(m):
        nu[i] = wrapped(measured[t, i] - values[chosen[i], 0], moduli[i]) - shift[i]
        there = math.isfinite(nu[i])  # what is missing in one of the points is so in their mean
        missing[i] = 0.0 if there else 1.0
        count += there
        if not there:
            nu[i] = shift[i] = 0.0
            for k in range(n):
                odd[i, k] = even[k, i] = 0.0
    return count


@inlined
def _inflation(even: Any, shift: Any, w: Any, weight: float, centre: float, bend: Any, omega: Any) -> None:
    """Write I + Omega, whitened by the lower triangular `w`; its lower triangle alone."""
    n, m = even.shape
    own = is_diagonal(w)
    for i in range(m):
        total = 0.0
        for j in range(i if own else 0, i + 1):
            total += w[i, j] * shift[j]
        bend[i] = total
    for k in range(n):
        for i in range(m - 1, -1, -1):  # in place: row i of W needs the elements up to i
            total = 0.0
            for j in range(i if own else 0, i + 1):
                total += w[i, j] * (even[k, j] - shift[j])
            even[k, i] = total
    products(even, omega)
    for i in range(m):
        for j in range(i + 1):
            omega[i, j] = 2.0 * weight * omega[i, j] + centre * bend[i] * bend[j]
        omega[i, i] += 1.0


@inlined
def _whiten(omega: Any, w: Any, work: Any, inflated: Any, nu: Any, odd: Any, whitened: Any, rows: Any) -> None:
    """Write F nu and the rows F odd (m, n), F the inverse of the root of R + Omega; NaN where it has none."""
    m, n = rows.shape
    _root(omega, work)
    for i in range(m):
        for j in range(i + 1):
            inflated[i, j] = w[i, j]
        for k in range(i):
            shared = omega[i, k]
            for j in range(k + 1):
                inflated[i, j] -= shared * inflated[k, j]
        for j in range(i + 1):
            inflated[i, j] /= omega[i, i]
    for i in range(m):
        total = 0.0
        for k in range(n):
            rows[i, k] = 0.0
        for j in range(i + 1):
            shared = inflated[i, j]
            total += shared * nu[j]
            for k in range(n):
                rows[i, k] += shared * odd[j, k]
        whitened[i] = total


@inlined
def _root(omega: Any, work: Any) -> None:
    """Replace the lower triangle by its factor, repaired where the centre's weight is so negative that it has none."""
    m = omega.shape[0]
    finite = True
    for i in range(m):
        for j in range(i + 1):
            finite = finite and math.isfinite(omega[i, j])
            work[0, i, j] = work[0, j, i] = omega[i, j]
    if not factor(omega, m):
        if finite:
            repair(work, m, omega)
        else:
            for i in range(m):
                for j in range(i + 1):
                    omega[i, j] = math.nan
