"""What biases do to a model's kernel: rows that read too much, axes that are turned, and how biases walk.

Each calls another kernel, by the address that is its first parameter; behind its own parameters come the other's.
"""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.calling import call_kernel, kernel
from quietfix.systems.kernels.compiling import inlined
from quietfix.systems.kernels.models.sight import nadir_axes

__all__ = ["added", "turned", "walking", "walking_noise"]


@kernel
def added(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Rows with biases added; parameters: address, states of the kernel, how many, then row, state and share of each.

    A row that is missing stays so.
    """
    n, count = int(parameters[1]), int(parameters[2])
    if call_kernel(int(parameters[0]), state[:n], platforms, parameters[3 + 3 * count :], value, jacobian[:, :n]):
        raise ValueError("the kernel of the rows raised")
    for i in range(count):
        row, place, share = int(parameters[3 + 3 * i]), int(parameters[4 + 3 * i]), parameters[5 + 3 * i]
        value[row] += share * state[place]
        if jacobian.shape[0] > 0:
            jacobian[row, place] += share


@inlined
def _applied(m: Any, x: float, y: float, z: float) -> Any:
    return m[0] * x + m[1] * y + m[2] * z, m[3] * x + m[4] * y + m[5] * z, m[6] * x + m[7] * y + m[8] * z


@inlined
def _transposed(m: Any) -> Any:
    return m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]


@inlined
def _times(a: Any, b: Any) -> Any:
    """Return the product of two matrices, nine numbers each, row by row."""
    p, q, r = _applied(a, b[0], b[3], b[6]), _applied(a, b[1], b[4], b[7]), _applied(a, b[2], b[5], b[8])
    return p[0], q[0], r[0], p[1], q[1], r[1], p[2], q[2], r[2]


@inlined
def _series(first: float, second: float, x: float, y: float, z: float) -> Any:
    """Return I + first [v]x + second [v]x^2 for the vector v."""
    square = x * x + y * y + z * z
    return (
        1.0 + second * (x * x - square),
        second * x * y - first * z,
        second * x * z + first * y,
        second * x * y + first * z,
        1.0 + second * (y * y - square),
        second * y * z - first * x,
        second * x * z - first * y,
        second * y * z + first * x,
        1.0 + second * (z * z - square),
    )


@inlined
def _turn(x: float, y: float, z: float) -> Any:
    """Return R^T and J_l of a rotation vector; see `quietfix.systems.geometry.misalignment`."""
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    if angle < 1e-2:
        sine = 1.0 - square / 6.0 + square * square / 120.0 - square * square * square / 5040.0
        third = 1.0 / 6.0 - square / 120.0 + square * square / 5040.0
        half = 1.0 - square / 24.0 + square * square / 1920.0 - square * square * square / 322560.0
    else:
        sine = math.sin(angle) / angle
        third = (angle - math.sin(angle)) / (square * angle)
        half = math.sin(0.5 * angle) / (0.5 * angle)
    versine = 0.5 * half * half
    return _series(-sine, versine, x, y, z), _series(versine, third, x, y, z)


@inlined
def _axes(kind: int, platforms: Any, platform: int, earth_rate: float) -> Any:
    """Return the axes of a platform as rows: 0, those of the states; 1, pointing to nadir."""
    if kind == 0:
        return 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0
    ax, ay, az, bx, by, bz = nadir_axes(platforms, platform, earth_rate)
    return ax, ay, az, bx, by, bz, ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@inlined
def _offset(state: Any, first: int, axes: int, platforms: Any, platform: int, own: int) -> Any:
    """Return position or velocity relative to a platform; in the plane its third component is 0."""
    x, y = state[first] - platforms[platform, own], state[first + 1] - platforms[platform, own + 1]
    return x, y, (state[first + 2] - platforms[platform, own + 2] if axes > 2 else 0.0)


@inlined
def _put(state: Any, first: int, axes: int, platforms: Any, platform: int, own: int, offset: Any) -> None:
    for i in range(axes):
        state[first + i] = platforms[platform, own + i] + offset[i]


@inlined
def _turn_row(k: int, first: int, axes: int, back: Any, slope: Any, jacobian: Any) -> Any:
    """Carry a row's derivative by position or velocity into the true axes; return that by the rotation vector."""
    x, y, z = jacobian[k, first], jacobian[k, first + 1], (jacobian[k, first + 2] if axes > 2 else 0.0)
    turned_row = _applied(_transposed(back), x, y, z)
    for i in range(axes):
        jacobian[k, first + i] = turned_row[i]
    return _applied(_transposed(slope), x, y, z)


@inlined
def _slope(home: Any, frame: Any, offset: Any, change: Any) -> Any:
    """Return the derivative of the offset as it is seen, by the rotation vector."""
    x, y, z = _applied(frame, offset[0], offset[1], offset[2])
    return _times(_times(home, (0.0, -z, y, z, 0.0, -x, -y, x, 0.0)), change)


@kernel
def turned(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Directions in axes that are turned; see `quietfix.systems.geometry.misalignment.seen_from_turned_axes`.

    parameters: address, states of the kernel, platform, axes of the space, kind of the platform's axes, Earth rate,
    then the states that are the rotation about x, y and z, or -1. The state is replaced by the one that the kernel has
    to see while it is called, and is itself again afterwards, bit by bit.
    """
    n, platform, axes = int(parameters[1]), int(parameters[2]), int(parameters[3])
    jx, jy, jz = int(parameters[6]), int(parameters[7]), int(parameters[8])
    moving = n >= 2 * axes
    back, change = _turn(state[jx] if jx >= 0 else 0.0, state[jy] if jy >= 0 else 0.0, state[jz] if jz >= 0 else 0.0)
    frame = _axes(int(parameters[4]), platforms, platform, parameters[5])
    home = _times(_transposed(frame), back)
    whole = _times(home, frame)
    place = _offset(state, 0, axes, platforms, platform, 0)
    speed = _offset(state, axes, axes, platforms, platform, 3) if moving else (0.0, 0.0, 0.0)
    x, y, z = state[0], state[1], (state[2] if axes > 2 else 0.0)
    u, v, w = 0.0, 0.0, 0.0
    if moving:
        u, v, w = state[axes], state[axes + 1], (state[axes + 2] if axes > 2 else 0.0)
        _put(state, axes, axes, platforms, platform, 3, _applied(whole, speed[0], speed[1], speed[2]))
    _put(state, 0, axes, platforms, platform, 0, _applied(whole, place[0], place[1], place[2]))
    failed = call_kernel(int(parameters[0]), state[:n], platforms, parameters[9:], value, jacobian[:, :n])
    state[0], state[1] = x, y
    if moving:
        state[axes], state[axes + 1] = u, v
    if axes > 2:
        state[2] = z
        if moving:
            state[5] = w
    if failed:
        raise ValueError("the kernel of the rows raised")
    if jacobian.shape[0] == 0:
        return
    of_place, of_speed = _slope(home, frame, place, change), _slope(home, frame, speed, change)
    for k in range(value.shape[0]):
        a, b, c = _turn_row(k, 0, axes, whole, of_place, jacobian)
        if moving:
            d, e, f = _turn_row(k, axes, axes, whole, of_speed, jacobian)
            a, b, c = a + d, b + e, c + f
        if jx >= 0:
            jacobian[k, jx] = a
        if jy >= 0:
            jacobian[k, jy] = b
        if jz >= 0:
            jacobian[k, jz] = c


@kernel
def walking(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Move a target, with components behind it that stay as they are; parameters: address, states of the motion."""
    n = int(parameters[1])
    if call_kernel(int(parameters[0]), state[:n], platforms, parameters[2:], value[:n], jacobian[:n, :n]):
        raise ValueError("the kernel of the motion raised")
    for i in range(n, value.shape[0]):
        value[i] = state[i]
        if jacobian.shape[0] > 0:
            jacobian[i, i] = 1.0


@kernel
def walking_noise(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Process noise, into the place of the derivative; parameters: address, states of the motion, biases, variances."""
    n, count = int(parameters[1]), int(parameters[2])
    if call_kernel(int(parameters[0]), state[:n], platforms, parameters[3 + count :], value[:n], jacobian[:n, :n]):
        raise ValueError("the kernel of the noise raised")
    for i in range(count):
        jacobian[n + i, n + i] = parameters[3 + i]
