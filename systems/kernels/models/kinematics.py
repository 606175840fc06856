"""One satellite seen from another: angles, their rates, radial velocity and radial acceleration."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.calling import kernel
from quietfix.systems.kernels.compiling import inlined
from quietfix.systems.kernels.models.arctangent import angle
from quietfix.systems.kernels.models.gravity import gradient, pull

__all__ = ["relative_kinematics"]


@inlined
def _write(k: int, value: Any, jacobian: Any, number: float, position: Any, velocity: Any) -> None:
    value[k] = number
    if jacobian.shape[0] > 0:
        for i in range(3):
            jacobian[k, i] = position[i]
            jacobian[k, 3 + i] = velocity[i]


@inlined
def _sum(a: float, x: Any, b: float, y: Any) -> Any:
    return a * x[0] + b * y[0], a * x[1] + b * y[1], a * x[2] + b * y[2]


@inlined
def _dot(x: Any, y: Any) -> float:
    return x[0] * y[0] + x[1] * y[1] + x[2] * y[2]


@kernel
def relative_kinematics(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Rows of `quietfix.systems.angles.relative_kinematics.ROWS`, which see for the equations.

    parameters: observer, mu, 1.5 J2 R^2 or 0, then the number of each row.
    """
    i = int(parameters[0])
    x = (state[0] - platforms[i, 0], state[1] - platforms[i, 1], state[2] - platforms[i, 2])
    w = (state[3] - platforms[i, 3], state[4] - platforms[i, 4], state[5] - platforms[i, 5])
    square = x[0] * x[0] + x[1] * x[1]
    level, r = math.sqrt(square), math.sqrt(square + x[2] * x[2])
    ce, se, cb, sb = level / r, x[2] / r, x[0] / level, x[1] / level
    zero = (0.0, 0.0, 0.0)
    radial, azimuthal, elevational = (x[0] / r, x[1] / r, x[2] / r), (-sb, cb, 0.0), (-cb * se, -sb * se, ce)
    azimuth_rate, elevation_rate = _dot(azimuthal, w) / level, _dot(elevational, w) / r
    speed = _dot(radial, w)
    by_level, by_range = _sum(1.0 / level, azimuthal, 0.0, zero), _sum(1.0 / r, elevational, 0.0, zero)
    tangent = _sum(1.0 / r, w, -speed / r, radial)
    for k in range(value.shape[0]):
        row = int(parameters[3 + k])
        if row == 0:
            _write(k, value, jacobian, angle(x[1], x[0]), by_level, zero)
        elif row == 1:
            _write(k, value, jacobian, angle(x[2], level), by_range, zero)
        elif row == 2:
            # the derivative of grad(beta) . w with respect to the position is the rate of grad(beta) along w
            spread = speed * ce - r * se * elevation_rate
            turned = _sum(-azimuth_rate / level, (cb, sb, 0.0), -spread / level, by_level)
            _write(k, value, jacobian, azimuth_rate, turned, by_level)
        elif row == 3:
            turning = _sum(elevation_rate, radial, azimuth_rate * se, azimuthal)
            _write(k, value, jacobian, elevation_rate, _sum(-1.0 / r, turning, -speed / r, by_range), by_range)
        elif row == 4:
            _write(k, value, jacobian, speed, tangent, radial)
        else:
            across = _dot(w, w) - speed * speed
            mu, flat = parameters[1], parameters[2]
            own = pull(state[0], state[1], state[2], mu, flat)
            other = pull(platforms[i, 0], platforms[i, 1], platforms[i, 2], mu, flat)
            relative = _sum(1.0, own, -1.0, other)
            along = _dot(radial, relative)
            g = gradient(state[0], state[1], state[2], mu, flat)
            pulled = (
                g[0] * radial[0] + g[1] * radial[1] + g[2] * radial[2],
                g[1] * radial[0] + g[3] * radial[1] + g[4] * radial[2],
                g[2] * radial[0] + g[4] * radial[1] + g[5] * radial[2],
            )
            side = _sum(1.0 / r, relative, -along / r, radial)
            rest = _sum(-across / (r * r), radial, -2.0 * (speed / r), tangent)
            slope = _sum(1.0, _sum(1.0, pulled, 1.0, side), 1.0, rest)
            _write(k, value, jacobian, along + across / r, slope, _sum(2.0, tangent, 0.0, zero))
