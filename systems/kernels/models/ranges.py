"""Ranges, range rates and received power at stations."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.calling import kernel
from quietfix.systems.kernels.models.sight import line_of_sight

__all__ = ["range_rates", "ranges", "received_power"]


@kernel
def ranges(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Distances; parameters: the stations."""
    for k in range(value.shape[0]):
        distance, x, y, z = line_of_sight(state, platforms, int(parameters[k]))
        value[k] = distance
        if jacobian.shape[0] > 0:
            jacobian[k, 0], jacobian[k, 1], jacobian[k, 2] = x, y, z


@kernel
def range_rates(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Scaled range rates with what all have in common.

    parameters: the scale, the state that is added or -1, 1 where the target has no velocity, then the stations.
    """
    scale, bias, at_rest = parameters[0], int(parameters[1]), parameters[2] > 0.0
    p, q, r = state[0], state[1], state[2]
    a0, b0, c0 = (0.0, 0.0, 0.0) if at_rest else (state[3], state[4], state[5])
    common = state[bias] if bias >= 0 else 0.0
    for k in range(value.shape[0]):
        i = int(parameters[3 + k])
        x, y, z = p - platforms[i, 0], q - platforms[i, 1], r - platforms[i, 2]
        u, v, w = a0 - platforms[i, 3], b0 - platforms[i, 4], c0 - platforms[i, 5]
        distance = math.sqrt(x * x + y * y + z * z)
        rate = (x * u + y * v + z * w) / distance
        value[k] = scale * (rate + common)
        if jacobian.shape[0] > 0:
            a, b, c = x / distance, y / distance, z / distance
            jacobian[k, 0] = scale * ((u - rate * a) / distance)
            jacobian[k, 1] = scale * ((v - rate * b) / distance)
            jacobian[k, 2] = scale * ((w - rate * c) / distance)
            if not at_rest:
                jacobian[k, 3], jacobian[k, 4], jacobian[k, 5] = scale * a, scale * b, scale * c
            if bias >= 0:
                jacobian[k, bias] = scale


@kernel
def received_power(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Power by the logarithmic law; parameters: power at 1 m, exponent, then the stations."""
    power, exponent = parameters[0], parameters[1]
    for k in range(value.shape[0]):
        distance, x, y, z = line_of_sight(state, platforms, int(parameters[2 + k]))
        value[k] = power - 10.0 * exponent * math.log10(distance)
        if jacobian.shape[0] > 0:
            steep = -(10.0 / math.log(10.0) * exponent)
            jacobian[k, 0], jacobian[k, 1], jacobian[k, 2] = (
                steep * x / distance,
                steep * y / distance,
                steep * z / distance,
            )
