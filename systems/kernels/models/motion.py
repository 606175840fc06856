"""Motions of one state: orbits in the gravity of the Earth, and the current statistical model."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.kernels.calling import kernel
from quietfix.systems.kernels.compiling import inlined
from quietfix.systems.kernels.models.gravity import gradient, pull

__all__ = ["current_statistical", "current_statistical_noise", "orbital"]


@kernel
def current_statistical(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """One step with the mean acceleration held that stands in `platforms` (1, 3).

    parameters: dt, what an acceleration adds to position, velocity and itself, what a mean acceleration adds to them.
    """
    dt, f02, f12, f22 = parameters[0], parameters[1], parameters[2], parameters[3]
    u0, u1, u2 = parameters[4], parameters[5], parameters[6]
    for i in range(value.shape[0]):
        value[i] = state[i]
    for k in range(3):
        p, v, a, held = state[k], state[3 + k], state[6 + k], platforms[0, k]
        value[k] = p + dt * v + f02 * a + u0 * held
        value[3 + k] = v + f12 * a + u1 * held
        value[6 + k] = f22 * a + u2 * held
    if jacobian.shape[0] > 0:
        for i in range(value.shape[0]):
            jacobian[i, i] = 1.0
        for k in range(3):
            jacobian[k, 3 + k], jacobian[k, 6 + k] = dt, f02
            jacobian[3 + k, 6 + k], jacobian[6 + k, 6 + k] = f12, f22


@kernel
def current_statistical_noise(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Process noise, into the place of the derivative: of a unit variance times sigma^2 of each axis, and the biases'.

    parameters: q11, q12, q13, q22, q23, q33, largest and smallest acceleration of each axis, floor, then the variance
    that each bias gains.
    """
    q = parameters
    for k in range(3):
        held = platforms[0, k]
        margin = (q[6 + k] if held >= 0.0 else q[9 + k]) - held
        variance = max((4.0 - math.pi) / math.pi * (margin * margin), q[12] * q[12])
        p, v, a = k, 3 + k, 6 + k
        jacobian[p, p] = variance * q[0]
        jacobian[p, v] = jacobian[v, p] = variance * q[1]
        jacobian[p, a] = jacobian[a, p] = variance * q[2]
        jacobian[v, v] = variance * q[3]
        jacobian[v, a] = jacobian[a, v] = variance * q[4]
        jacobian[a, a] = variance * q[5]
    for i in range(9, jacobian.shape[0]):
        jacobian[i, i] = q[13 + i - 9]


@inlined
def _times(g: Any, x: float, y: float, z: float) -> Any:
    return g[0] * x + g[1] * y + g[2] * z, g[1] * x + g[3] * y + g[4] * z, g[2] * x + g[4] * y + g[5] * z


@inlined
def _turn_column(column: int, jacobian: Any, h: float, g1: Any, g2: Any, g3: Any, g4: Any) -> None:
    """Carry a column of the transition through one step: the stages of the integrator, differentiated one by one."""
    half, sixth = 0.5 * h, h / 6.0
    p0, p1, p2 = jacobian[0, column], jacobian[1, column], jacobian[2, column]
    v0, v1, v2 = jacobian[3, column], jacobian[4, column], jacobian[5, column]
    a0, a1, a2 = _times(g1, p0, p1, p2)
    b0, b1, b2 = _times(g2, p0 + half * v0, p1 + half * v1, p2 + half * v2)
    s0, s1, s2 = v0 + half * a0, v1 + half * a1, v2 + half * a2
    c0, c1, c2 = _times(g3, p0 + half * s0, p1 + half * s1, p2 + half * s2)
    r0, r1, r2 = v0 + half * b0, v1 + half * b1, v2 + half * b2
    d0, d1, d2 = _times(g4, p0 + h * r0, p1 + h * r1, p2 + h * r2)
    jacobian[0, column] = p0 + sixth * (v0 + 2.0 * s0 + 2.0 * r0 + (v0 + h * c0))
    jacobian[1, column] = p1 + sixth * (v1 + 2.0 * s1 + 2.0 * r1 + (v1 + h * c1))
    jacobian[2, column] = p2 + sixth * (v2 + 2.0 * s2 + 2.0 * r2 + (v2 + h * c2))
    jacobian[3, column] = v0 + sixth * (a0 + 2.0 * b0 + 2.0 * c0 + d0)
    jacobian[4, column] = v1 + sixth * (a1 + 2.0 * b1 + 2.0 * c1 + d1)
    jacobian[5, column] = v2 + sixth * (a2 + 2.0 * b2 + 2.0 * c2 + d2)


@kernel
def orbital(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Classical Runge-Kutta steps and their derivative; parameters: step, number of steps, mu, 1.5 J2 R^2 or 0."""
    h, mu, flat = parameters[0], parameters[2], parameters[3]
    half, sixth = 0.5 * h, h / 6.0
    x, y, z, u, v, w = state[0], state[1], state[2], state[3], state[4], state[5]
    if jacobian.shape[0] > 0:
        for i in range(6):
            jacobian[i, i] = 1.0
    for _ in range(int(parameters[1])):
        a0, a1, a2 = pull(x, y, z, mu, flat)
        q0, q1, q2 = x + half * u, y + half * v, z + half * w
        b0, b1, b2 = pull(q0, q1, q2, mu, flat)
        s0, s1, s2 = u + half * a0, v + half * a1, w + half * a2
        m0, m1, m2 = x + half * s0, y + half * s1, z + half * s2
        c0, c1, c2 = pull(m0, m1, m2, mu, flat)
        r0, r1, r2 = u + half * b0, v + half * b1, w + half * b2
        e0, e1, e2 = x + h * r0, y + h * r1, z + h * r2
        d0, d1, d2 = pull(e0, e1, e2, mu, flat)
        if jacobian.shape[0] > 0:
            g1, g2 = gradient(x, y, z, mu, flat), gradient(q0, q1, q2, mu, flat)
            g3, g4 = gradient(m0, m1, m2, mu, flat), gradient(e0, e1, e2, mu, flat)
            for column in range(6):
                _turn_column(column, jacobian, h, g1, g2, g3, g4)
        x += sixth * (u + 2.0 * s0 + 2.0 * r0 + (u + h * c0))
        y += sixth * (v + 2.0 * s1 + 2.0 * r1 + (v + h * c1))
        z += sixth * (w + 2.0 * s2 + 2.0 * r2 + (w + h * c2))
        u += sixth * (a0 + 2.0 * b0 + 2.0 * c0 + d0)
        v += sixth * (a1 + 2.0 * b1 + 2.0 * c1 + d1)
        w += sixth * (a2 + 2.0 * b2 + 2.0 * c2 + d2)
    value[0], value[1], value[2], value[3], value[4], value[5] = x, y, z, u, v, w
