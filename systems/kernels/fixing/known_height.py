"""Newton's iteration for the position that two range differences and a height mean, one trial after the other."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.compiling import compiled, inlined
from quietfix.systems.kernels.models.states import vertical

__all__ = ["newton"]

_SMALLEST_DETERMINANT = 1e-12  # of unit vectors


@inlined
def _cross(a: Any, b: Any) -> Any:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def _sight(p: Any, satellite: Any) -> Any:
    """Return the distance and the unit vector from a satellite to a place."""
    x, y, z = p[0] - satellite[0], p[1] - satellite[1], p[2] - satellite[2]
    distance = math.sqrt(x * x + y * y + z * z)
    return distance, x / distance, y / distance, z / distance


@inlined
def _step(ranges: Any, satellites: Any, height: float, p: Any) -> Any:
    """Return Newton's step and whether it is one: where the gradient is singular it is the residual."""
    far, fx, fy, fz = _sight(p, satellites[0])
    one, ax, ay, az = _sight(p, satellites[1])
    other, bx, by, bz = _sight(p, satellites[2])
    nx, ny, nz, above = vertical(p[0], p[1], p[2])
    a, b, c = (ax - fx, ay - fy, az - fz), (bx - fx, by - fy, bz - fz), (nx, ny, nz)
    r = ranges[0] - (one - far), ranges[1] - (other - far), height - above
    bc, ca, ab = _cross(b, c), _cross(c, a), _cross(a, b)
    determinant = a[0] * bc[0] + a[1] * bc[1] + a[2] * bc[2]
    if abs(determinant) < _SMALLEST_DETERMINANT:
        return r[0], r[1], r[2], False
    x = (r[0] * bc[0] + r[1] * ca[0] + r[2] * ab[0]) / determinant
    y = (r[0] * bc[1] + r[1] * ca[1] + r[2] * ab[1]) / determinant
    z = (r[0] * bc[2] + r[1] * ca[2] + r[2] * ab[2]) / determinant
    return x, y, z, True


@inlined
def _in_sight(p: Any, satellites: Any) -> bool:
    """Return whether all satellites are above the horizon of a place."""
    nx, ny, nz, _ = vertical(p[0], p[1], p[2])
    for i in range(satellites.shape[0]):
        x, y, z = satellites[i, 0] - p[0], satellites[i, 1] - p[1], satellites[i, 2] - p[2]
        if not x * nx + y * ny + z * nz > 0.0:
            return False
    return True


@compiled("int64(float64[:,::1],float64[:,:,::1],float64[::1],int64,float64,float64,float64[:,::1])")
def newton(
    ranges: Any, satellites: Any, height: Any, iterations: int, largest: float, converged: float, position: Any
) -> int:
    """Write into `position` (trials, 3), which holds the starts, where it ends; 0 is returned.

    NaN where it does not end, or not in sight of all satellites.

    `ranges` (trials, 2) are the differences to satellite 0, `satellites` (1 or trials, 3, 3), `height` (trials,) above
    the ellipsoid. No step is longer than `largest`; the last is shorter than `converged`.
    """
    for t in range(position.shape[0]):
        p, seen = position[t], satellites[t if satellites.shape[0] > 1 else 0]
        done = False
        for _ in range(iterations):
            x, y, z, regular = _step(ranges[t], seen, height[t], p)
            size = math.sqrt(x * x + y * y + z * z)
            if not size < math.inf:
                break
            share = min(1.0, largest / max(size, 1.0))
            p[0], p[1], p[2] = p[0] + x * share, p[1] + y * share, p[2] + z * share
            if regular and size < converged:
                done = True
                break
        if not (done and _in_sight(p, seen)):
            p[0] = p[1] = p[2] = math.nan
    return 0
