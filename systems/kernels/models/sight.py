"""Lines of sight of one state, and the measurements that are differences along them."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.kernels.calling import kernel
from quietfix.systems.kernels.compiling import inlined

__all__ = ["fdoa", "ground_tdoa", "interferometer_phase", "line_of_sight", "nadir_axes", "slope", "tdoa"]

_RADIUS = 6371008.8  # as in quietfix.systems.geometry.wave_path


@inlined
def line_of_sight(state: Any, platforms: Any, i: int) -> Any:
    """Return range [m] and direction from platform i to the target."""
    x, y, z = state[0] - platforms[i, 0], state[1] - platforms[i, 1], state[2] - platforms[i, 2]
    distance = math.sqrt(x * x + y * y + z * z)
    return distance, x / distance, y / distance, z / distance


@inlined
def slope(state: Any, platforms: Any, i: int) -> Any:
    """Return direction, range rate and its derivative with respect to the position (I - u u^T)(v - v_i)/r."""
    distance, x, y, z = line_of_sight(state, platforms, i)
    a, b, c = state[3] - platforms[i, 3], state[4] - platforms[i, 4], state[5] - platforms[i, 5]
    rate = x * a + y * b + z * c
    return x, y, z, rate, (a - rate * x) / distance, (b - rate * y) / distance, (c - rate * z) / distance


@kernel
def tdoa(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Travel times minus that to the reference; parameters: the reference, then the receivers."""
    r0, x0, y0, z0 = line_of_sight(state, platforms, int(parameters[0]))
    for k in range(value.shape[0]):
        r, x, y, z = line_of_sight(state, platforms, int(parameters[1 + k]))
        value[k] = r / SPEED_OF_LIGHT - r0 / SPEED_OF_LIGHT
        if jacobian.shape[0] > 0:
            jacobian[k, 0] = x / SPEED_OF_LIGHT - x0 / SPEED_OF_LIGHT
            jacobian[k, 1] = y / SPEED_OF_LIGHT - y0 / SPEED_OF_LIGHT
            jacobian[k, 2] = z / SPEED_OF_LIGHT - z0 / SPEED_OF_LIGHT


@inlined
def _ground_path(chord: float, mirror: float, air: float) -> Any:
    """Return length and slope of a wave's path over a chord; see `quietfix.systems.geometry.wave_path.WavePath`."""
    half = chord / (2.0 * _RADIUS)
    if half > 0.999:
        half = 0.999
    turn = math.sqrt(1.0 - half * half)
    if mirror == 0.0:
        return air * 2.0 * _RADIUS * math.asin(half), air / turn
    top = _RADIUS + mirror
    leg = math.sqrt(mirror * mirror + 2.0 * _RADIUS * top * (half * half) / (1.0 + turn))
    return 2.0 * leg, top * half / (turn * leg)


@kernel
def ground_tdoa(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """As `tdoa`, along the ground or by a mirror; parameters: its height, 1 + refractivity, then as of `tdoa`."""
    mirror, air = parameters[0], parameters[1]
    r0, x0, y0, z0 = line_of_sight(state, platforms, int(parameters[2]))
    length0, slope0 = _ground_path(r0, mirror, air)
    for k in range(value.shape[0]):
        r, x, y, z = line_of_sight(state, platforms, int(parameters[3 + k]))
        length, steep = _ground_path(r, mirror, air)
        value[k] = length / SPEED_OF_LIGHT - length0 / SPEED_OF_LIGHT
        if jacobian.shape[0] > 0:
            jacobian[k, 0] = steep * x / SPEED_OF_LIGHT - slope0 * x0 / SPEED_OF_LIGHT
            jacobian[k, 1] = steep * y / SPEED_OF_LIGHT - slope0 * y0 / SPEED_OF_LIGHT
            jacobian[k, 2] = steep * z / SPEED_OF_LIGHT - slope0 * z0 / SPEED_OF_LIGHT


@kernel
def fdoa(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Scaled range rates minus that of the reference; parameters: the scale, the reference, then the receivers."""
    scale = parameters[0]
    x0, y0, z0, rate0, a0, b0, c0 = slope(state, platforms, int(parameters[1]))
    for k in range(value.shape[0]):
        x, y, z, rate, a, b, c = slope(state, platforms, int(parameters[2 + k]))
        value[k] = scale * rate - scale * rate0
        if jacobian.shape[0] > 0:
            jacobian[k, 0] = scale * a - scale * a0
            jacobian[k, 1] = scale * b - scale * b0
            jacobian[k, 2] = scale * c - scale * c0
            jacobian[k, 3] = scale * x - scale * x0
            jacobian[k, 4] = scale * y - scale * y0
            jacobian[k, 5] = scale * z - scale * z0


@inlined
def nadir_axes(platforms: Any, i: int, earth_rate: float) -> Any:
    """Return x along the inertial velocity and y = z x x, z to nadir; see `quietfix.systems.earth.frames`."""
    p, q, r = platforms[i, 0], platforms[i, 1], platforms[i, 2]
    a, b, c = platforms[i, 3] - earth_rate * q, platforms[i, 4] + earth_rate * p, platforms[i, 5]
    radius = math.sqrt(p * p + q * q + r * r)
    zx, zy, zz = -p / radius, -q / radius, -r / radius
    along = a * zx + b * zy + c * zz
    a, b, c = a - along * zx, b - along * zy, c - along * zz
    speed = math.sqrt(a * a + b * b + c * c)
    a, b, c = a / speed, b / speed, c / speed
    return a, b, c, zy * c - zz * b, zz * a - zx * c, zx * b - zy * a


@kernel
def interferometer_phase(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Phases of baselines along and across the track; parameters: 2 pi n, Earth rate, platform, then 0 or 1 a row."""
    scale, i = parameters[0], int(parameters[2])
    xa, xb, xc, ya, yb, yc = nadir_axes(platforms, i, parameters[1])
    distance, x, y, z = line_of_sight(state, platforms, i)
    for k in range(value.shape[0]):
        along = parameters[3 + k] == 0.0
        a, b, c = scale * (xa if along else ya), scale * (xb if along else yb), scale * (xc if along else yc)
        phase = a * x + b * y + c * z
        value[k] = phase
        if jacobian.shape[0] > 0:
            jacobian[k, 0] = (a - phase * x) / distance
            jacobian[k, 1] = (b - phase * y) / distance
            jacobian[k, 2] = (c - phase * z) / distance
