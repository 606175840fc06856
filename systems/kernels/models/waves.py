"""One wave front at several moving receivers; see `quietfix.systems.geometry.light_time.arrival` for the equations."""

from __future__ import annotations

import math
from typing import Any

from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.kernels.calling import kernel
from quietfix.systems.kernels.compiling import inlined
from quietfix.systems.kernels.models.gravity import pull

__all__ = ["wave_fdoa", "wave_tdoa"]


@inlined
def _dot(a: Any, b: Any) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def _sum(a: Any, s: float, b: Any) -> Any:
    """Return a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@inlined
def _scaled(s: float, a: Any) -> Any:
    return s * a[0], s * a[1], s * a[2]


@inlined
def _spun(rate: float, a: Any) -> Any:
    """Return the cross product with the Earth's rotation."""
    return -rate * a[1], rate * a[0], 0.0


@inlined
def _travel(offset: Any, velocity: Any, acceleration: Any, since: float) -> Any:
    """Return the t with c t = |offset + velocity s + acceleration s^2/2|, s = t - since; that vector and its rate."""
    start = _sum(offset, -since, velocity)
    closing = _dot(start, velocity)
    slack = SPEED_OF_LIGHT * SPEED_OF_LIGHT - _dot(velocity, velocity)
    t = (closing + math.sqrt(closing * closing + slack * _dot(start, start))) / slack
    s = t - since
    rate, path = _sum(velocity, s, acceleration), _sum(_sum(offset, s, velocity), 0.5 * (s * s), acceleration)
    distance = math.sqrt(_dot(path, path))
    t -= (SPEED_OF_LIGHT * t - distance) / (SPEED_OF_LIGHT - _dot(path, rate) / distance)
    s = t - since
    return t, _sum(_sum(offset, s, velocity), 0.5 * (s * s), acceleration), _sum(velocity, s, acceleration)


@inlined
def _receiver(platforms: Any, i: int, rate: float, mu: float, radius: float, flat: float) -> Any:
    """Return position, inertial velocity and inertial acceleration: gravity in orbit, else that of a straight line."""
    p = (platforms[i, 0], platforms[i, 1], platforms[i, 2])
    fixed = (platforms[i, 3], platforms[i, 4], platforms[i, 5])
    v = _sum(fixed, 1.0, _spun(rate, p))
    square = _dot(p, p)
    along = _dot(p, v)
    moment = square * _dot(v, v) - along * along
    energy = _dot(v, v) - 2.0 * mu / math.sqrt(max(square, 1.0))
    eccentricity = math.sqrt(max(1.0 + energy * moment / (mu * mu), 0.0))
    if moment / mu > radius * (1.0 + eccentricity):
        return p, v, pull(p[0], p[1], p[2], mu, flat)
    return p, v, _spun(rate, _sum(_spun(rate, p), 2.0, fixed))


@inlined
def _emission(state: Any, platforms: Any, q: Any, reference: int) -> Any:
    """Return travel time to the reference, direction, place and velocity of emission, acceleration of the emitter."""
    rate = q[0]
    x, fixed = (state[0], state[1], state[2]), (state[3], state[4], state[5])
    v = _sum(fixed, 1.0, _spun(rate, x))
    a = _spun(rate, _sum(v, 1.0, fixed))
    p0 = (platforms[reference, 0], platforms[reference, 1], platforms[reference, 2])
    t0, path0, ve = _travel(_sum(p0, -1.0, x), v, _scaled(-1.0, a), 0.0)
    return t0, _scaled(1.0 / (SPEED_OF_LIGHT * t0), path0), _sum(_sum(x, -t0, v), 0.5 * (t0 * t0), a), ve, a


@inlined
def _hearing(platforms: Any, q: Any, i: int, t0: float, emitted: Any) -> Any:
    """Return travel time, direction, the receiver's velocity then and its acceleration."""
    p, v, a = _receiver(platforms, i, q[0], q[1], q[2], q[3])
    t, path, u = _travel(_sum(p, -1.0, emitted), v, a, t0)
    return t, _scaled(1.0 / (SPEED_OF_LIGHT * t), path), u, a


@inlined
def _emission_slope(j: int, rate: float, front: Any) -> Any:
    """Return by the j-th component of the state: travel time to the reference, minus the place, velocity then."""
    t0, n0, _, ve, a = front
    unit = (1.0 if j % 3 == 0 else 0.0, 1.0 if j % 3 == 1 else 0.0, 1.0 if j % 3 == 2 else 0.0)
    spun = _spun(rate, unit)
    if j < 3:
        held = _sum(_sum(_scaled(t0, spun), -0.5 * (t0 * t0), _spun(rate, spun)), -1.0, unit)
        dve = _sum(spun, -t0, _spun(rate, spun))
    else:
        held = _sum(_scaled(t0, unit), -(t0 * t0), spun)
        dve = _sum(unit, -2.0 * t0, spun)
    dt0 = _dot(n0, held) / (SPEED_OF_LIGHT - _dot(n0, ve))
    return dt0, _sum(held, dt0, ve), _sum(dve, -dt0, a)


@inlined
def _heard_slope(heard: Any, late: float, receding: Any) -> Any:
    """Return the derivatives of the delay and of the path."""
    _, n, u, _ = heard
    fixed = _sum(receding, -late, u)
    dt = _dot(n, fixed) / (SPEED_OF_LIGHT - _dot(n, u))
    return dt - late, _sum(fixed, dt, u)


@kernel
def wave_tdoa(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Delays; parameters: Earth rate, mu, radius, 1.5 J2 R^2 or 0, the reference, then the receivers."""
    reference = int(parameters[4])
    front = _emission(state, platforms, parameters, reference)
    first = _hearing(platforms, parameters, reference, front[0], front[2])
    for k in range(value.shape[0]):
        heard = _hearing(platforms, parameters, int(parameters[5 + k]), front[0], front[2])
        value[k] = (heard[0] - front[0]) - (first[0] - front[0])
        if jacobian.shape[0] > 0:
            for j in range(6):
                dt0, receding, _ = _emission_slope(j, parameters[0], front)
                jacobian[k, j] = _heard_slope(heard, dt0, receding)[0] - _heard_slope(first, dt0, receding)[0]


@inlined
def _ratio(heard: Any, ve: Any) -> float:
    """Return received over emitted frequency, minus 1."""
    up, away = _dot(heard[1], heard[2]), _dot(heard[1], ve)
    return (away - up) / (SPEED_OF_LIGHT - away)


@inlined
def _ratio_slope(heard: Any, ve: Any, late: float, receding: Any, dve: Any) -> float:
    t, n, u, a = heard
    ddelay, dpath = _heard_slope(heard, late, receding)
    dn = _scaled(1.0 / (SPEED_OF_LIGHT * t), _sum(dpath, -_dot(n, dpath), n))
    dup = _dot(u, dn) + _dot(n, a) * ddelay
    daway = _dot(ve, dn) + _dot(n, dve)
    slack = SPEED_OF_LIGHT - _dot(n, ve)
    return (daway - dup) / slack + (_ratio(heard, ve) / slack) * daway


@kernel
def wave_fdoa(state: Any, platforms: Any, parameters: Any, value: Any, jacobian: Any) -> None:
    """Scaled frequency ratios; parameters: as of `wave_tdoa` up to J2, the scale, reference, then the receivers."""
    scale, reference = parameters[4], int(parameters[5])
    front = _emission(state, platforms, parameters, reference)
    ve = front[3]
    first = _hearing(platforms, parameters, reference, front[0], front[2])
    for k in range(value.shape[0]):
        heard = _hearing(platforms, parameters, int(parameters[6 + k]), front[0], front[2])
        value[k] = scale * _ratio(heard, ve) - scale * _ratio(first, ve)
        if jacobian.shape[0] > 0:
            for j in range(6):
                dt0, receding, dve = _emission_slope(j, parameters[0], front)
                jacobian[k, j] = scale * _ratio_slope(heard, ve, dt0, receding, dve) - scale * _ratio_slope(
                    first, ve, dt0, receding, dve
                )
