"""Directions to a target: bearings in local axes, over a horizon, and in the body frame of a satellite."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.calling import kernel
from quietfix.systems.kernels.compiling import inlined
from quietfix.systems.kernels.models.arctangent import angle
from quietfix.systems.kernels.models.sight import line_of_sight, nadir_axes
from quietfix.systems.kernels.models.states import vertical

__all__ = ["bearing", "direction", "direction_cosines", "horizon_bearing"]


@inlined
def _angles(x: float, y: float, z: float, value: Any) -> None:
    """Write the azimuth of an offset and, where there is room, its elevation; NaN for one that has no azimuth."""
    azimuth = angle(y, x)  # before it is chosen, see `angle`
    value[0] = math.nan if x == 0.0 and y == 0.0 else azimuth
    if value.shape[0] > 1:
        value[1] = angle(z, math.sqrt(x * x + y * y))


@inlined
def _slopes(x: float, y: float, z: float) -> Any:
    """Return the derivatives of azimuth (2) and elevation (3) with respect to the offset."""
    square = x * x + y * y
    ground = math.sqrt(square)
    slant = square + z * z
    return -y / square, x / square, -x * z / (ground * slant), -y * z / (ground * slant), ground / slant


@kernel
def bearing(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Azimuth, and elevation where there are two rows; parameters: the platform."""
    i = int(parameters[0])
    x, y = state[0] - platforms[i, 0], state[1] - platforms[i, 1]
    z = state[2] - platforms[i, 2] if value.shape[0] > 1 else 0.0
    _angles(x, y, z, value)
    if jacobian.shape[0] > 0:
        a, b, c, d, e = _slopes(x, y, z)
        jacobian[0, 0], jacobian[0, 1] = a, b
        if value.shape[0] > 1:
            jacobian[1, 0], jacobian[1, 1], jacobian[1, 2] = c, d, e


@kernel
def horizon_bearing(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Azimuth and elevation in east, north and up of an Earth-fixed platform; parameters: the platform."""
    i = int(parameters[0])
    p, q, r = platforms[i, 0], platforms[i, 1], platforms[i, 2]
    ux, uy, uz, _ = vertical(p, q, r)
    rho = math.sqrt(p * p + q * q)
    ex, ey = (-q / rho, p / rho) if rho > 0.0 else (0.0, 1.0)
    nx, ny, nz = -uz * ey, uz * ex, ux * ey - uy * ex
    x, y, z = state[0] - p, state[1] - q, state[2] - r
    east, north, up = ex * x + ey * y, nx * x + ny * y + nz * z, ux * x + uy * y + uz * z
    _angles(east, north, up, value)
    if jacobian.shape[0] > 0:
        a, b, c, d, e = _slopes(east, north, up)
        jacobian[0, 0], jacobian[0, 1], jacobian[0, 2] = a * ex + b * nx, a * ey + b * ny, b * nz
        if value.shape[0] > 1:
            jacobian[1, 0] = c * ex + d * nx + e * ux
            jacobian[1, 1] = c * ey + d * ny + e * uy
            jacobian[1, 2] = d * nz + e * uz


@kernel
def direction(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Azimuth and depression in the body frame of a satellite; parameters: Earth rate, platform."""
    i = int(parameters[1])
    ax, ay, az, bx, by, bz = nadir_axes(platforms, i, parameters[0])
    cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    distance, u, v, w = line_of_sight(state, platforms, i)
    x, y, z = ax * u + ay * v + az * w, bx * u + by * v + bz * w, cx * u + cy * v + cz * w
    square = x * x + y * y
    ground = math.sqrt(square)
    azimuth = angle(y, x)  # before it is chosen, see `angle`
    value[0] = math.nan if square == 0.0 else azimuth
    value[1] = angle(z, ground)
    if jacobian.shape[0] > 0:
        level, steep = square * distance, z / ground
        jacobian[0, 0] = (x * bx - y * ax) / level
        jacobian[0, 1] = (x * by - y * ay) / level
        jacobian[0, 2] = (x * bz - y * az) / level
        jacobian[1, 0] = (ground * cx - steep * (x * ax + y * bx)) / distance
        jacobian[1, 1] = (ground * cy - steep * (x * ay + y * by)) / distance
        jacobian[1, 2] = (ground * cz - steep * (x * az + y * bz)) / distance


@kernel
def direction_cosines(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Direction cosines along and across the track; parameters: Earth rate, platform."""
    i = int(parameters[1])
    ax, ay, az, bx, by, bz = nadir_axes(platforms, i, parameters[0])
    distance, u, v, w = line_of_sight(state, platforms, i)
    x, y = ax * u + ay * v + az * w, bx * u + by * v + bz * w
    value[0], value[1] = x, y
    if jacobian.shape[0] > 0:
        jacobian[0, 0], jacobian[0, 1] = (ax - x * u) / distance, (ay - x * v) / distance
        jacobian[1, 0], jacobian[1, 1] = (bx - y * u) / distance, (by - y * v) / distance
        jacobian[0, 2], jacobian[1, 2] = (az - x * w) / distance, (bz - y * w) / distance
