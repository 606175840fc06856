"""Exact arrival of one wave front at several moving receivers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.constants import EARTH_RATE, SPEED_OF_LIGHT
from quietfix.systems.trajectories.gravity import GravityConstants, acceleration

__all__ = ["Arrival", "arrival", "in_orbit"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Arrival:
    """How one wave front reaches p receivers; derivatives are with respect to (position, velocity).

    Attributes
    ----------
    travel, direction : ndarray, shape (...) and (..., 3)
        Time to the reference [s], and from the emitter to it.
    velocity, acceleration : ndarray, shape (..., 3)
        Inertial, of the emitter: when it emits [m/s], and throughout [m/s^2].
    travels, directions : ndarray, shape (..., p) and (..., p, 3)
        As the first two, to every receiver.
    receiver_velocity, receiver_acceleration : ndarray, shape (..., p, 3)
        Inertial, of each receiver: when it hears [m/s], and throughout [m/s^2].
    spin : ndarray, shape (3, 3)
        The matrix of the cross product with the Earth's rotation.
    """

    travel: Array
    direction: Array
    velocity: Array
    acceleration: Array
    travels: Array
    directions: Array
    receiver_velocity: Array
    receiver_acceleration: Array
    spin: Array

    @property
    def delay(self) -> Array:
        """Arrival after the arrival at the reference [s], shape (..., p)."""
        return self.travels - self.travel[..., None]

    @property
    def frequency_ratio(self) -> Array:
        """Received over emitted frequency, minus 1, shape (..., p)."""
        up, away = self._along_path
        return (away - up) / (SPEED_OF_LIGHT - away)

    @property
    def delay_jacobian(self) -> Array:
        """Derivative of `delay`, shape (..., p, 6)."""
        return self._slopes[0]

    @cached_property
    def frequency_ratio_jacobian(self) -> Array:
        """Derivative of `frequency_ratio`, shape (..., p, 6)."""
        ddelay, dpath, dve = self._slopes
        n, u, ve = self.directions, self.receiver_velocity, self.velocity[..., None, :]
        distance = (SPEED_OF_LIGHT * self.travels)[..., None, None]
        dn = (dpath - n[..., :, None] * _along(n, dpath)[..., None, :]) / distance
        dup = _along(u, dn) + _dot(n, self.receiver_acceleration)[..., None] * ddelay
        daway = _along(ve, dn) + _along(n, dve[..., None, :, :])
        slack = (SPEED_OF_LIGHT - self._along_path[1])[..., None]
        return (daway - dup) / slack + (self.frequency_ratio[..., None] / slack) * daway

    @cached_property
    def _along_path(self) -> tuple[Array, Array]:
        """Velocities of receiver and emitter along the path [m/s]."""
        n = self.directions
        return _dot(n, self.receiver_velocity), _dot(n, self.velocity[..., None, :])

    @cached_property
    def _slopes(self) -> tuple[Array, Array, Array]:
        """Derivatives of the delays, of the paths' vectors and of the emitter's velocity at emission."""
        # Columns of d(x), d(v), d(a) in terms of the Earth-fixed state: v and a depend on the position through the spin
        dx = np.concatenate([np.eye(3), np.zeros((3, 3))], axis=1)
        dv = np.concatenate([self.spin, np.eye(3)], axis=1)
        da = np.concatenate([self.spin @ self.spin, 2 * self.spin], axis=1)
        c, ve, late = SPEED_OF_LIGHT, self.velocity, self.travel[..., None, None]
        held = late * dv - (0.5 * late**2) * da - dx
        dt0 = _along(self.direction, held) / (c - _dot(self.direction, ve))[..., None]
        demitted = -held - ve[..., :, None] * dt0[..., None, :]
        dve = dv - late * da - self.acceleration[..., :, None] * dt0[..., None, :]
        n, u = self.directions, self.receiver_velocity
        fixed = -demitted[..., None, :, :] - u[..., :, None] * dt0[..., None, None, :]
        dt = _along(n, fixed) / (c - self._along_path[0])[..., None]
        return dt - dt0[..., None, :], fixed + u[..., :, None] * dt[..., None, :], dve


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...i,...i->...", a, b)


def _along(direction: Array, matrix: Array) -> Array:
    return np.einsum("...i,...ij->...j", direction, matrix)


def _travel_time(
    offset: Array, velocity: Array, acceleration: Array, since: Array | float
) -> tuple[Array, Array, Array]:
    """Solve ``c t = |offset + velocity s + acceleration s^2 / 2|``, s = t - since; return t, that vector, its rate.

    Without the acceleration the equation is quadratic; that root is off by a t^2/2c, 1e-12 s, and one step of Newton's
    method leaves its square.
    """
    start = offset - velocity * since
    closing = _dot(start, velocity)
    slack = SPEED_OF_LIGHT**2 - _dot(velocity, velocity)
    t = ((closing + np.sqrt(closing**2 + slack * _dot(start, start))) / slack)[..., None]
    for last in (False, True):
        s = t - since
        rate = velocity + acceleration * s
        path = offset + velocity * s + acceleration * (0.5 * s**2)
        if last:
            break
        distance = np.sqrt(_dot(path, path))[..., None]
        t = t - (SPEED_OF_LIGHT * t - distance) / (SPEED_OF_LIGHT - _dot(path, rate)[..., None] / distance)
    return t[..., 0], path, rate


def in_orbit(position: Array, velocity: Array, constants: GravityConstants) -> NDArray[np.bool_]:
    r"""Return whether something falls freely: the perigee of the orbit through its state is above the ground.

    Perigee :math:`(h^2/\mu)/(1+e)`, :math:`h = |p \times v|`, :math:`e^2 = 1 + (v^2 - 2\mu/r) h^2/\mu^2`.

    Parameters
    ----------
    position, velocity : ndarray, shape (..., 3)
        In inertial axes [m], [m/s].
    constants : GravityConstants

    Returns
    -------
    ndarray of bool, shape (...)
    """
    square = _dot(position, position)
    moment = square * _dot(velocity, velocity) - _dot(position, velocity) ** 2
    # the centre of the Earth is in no orbit either
    energy = _dot(velocity, velocity) - 2 * constants.mu / np.sqrt(np.maximum(square, 1.0))
    eccentricity = np.sqrt(np.maximum(1 + energy * moment / constants.mu**2, 0.0))
    falls: NDArray[np.bool_] = moment / constants.mu > constants.radius * (1 + eccentricity)
    return falls


def _platform_acceleration(fixed: Array, inertial: Array, spin: Array, constants: GravityConstants) -> Array:
    """Return the inertial acceleration: gravity in orbit, elsewhere that of a straight line in Earth-fixed axes."""
    position = fixed[..., :3]
    ground = np.einsum("ij,...j->...i", spin, 2 * fixed[..., 3:6] + np.einsum("ij,...j->...i", spin, position))
    free = in_orbit(position, inertial, constants)
    if not free.any():
        return ground
    with np.errstate(divide="ignore", invalid="ignore"):  # what is not in orbit may be at the centre of the Earth
        gravity = acceleration(position, constants, constants.j2 != 0)
    return np.where(free[..., None], gravity, ground)


def arrival(
    target: Array,
    platforms: Array,
    reference: int,
    earth_rate: float = EARTH_RATE,
    constants: GravityConstants | None = None,
) -> Arrival:
    r"""Follow one wave front from the emitter to every receiver.

    The front reaches the reference at the instant for which `target` and `platforms` are given. In inertial axes that
    coincide with the Earth-fixed ones at that instant, velocities are :math:`v + \omega\times p`, and all motion is of
    constant acceleration over the light time: of the target :math:`a = 2\omega\times v + \omega\times(\omega\times p)`,
    a straight line in Earth-fixed axes; of a receiver in orbit gravity, of any other the same as the target's. The
    travel time to the reference solves

    .. math:: c T_0 = |p_0 - x + v T_0 - a T_0^2/2|

    and, from there at :math:`x_e = x - v T_0 + a T_0^2/2`, that to receiver i, heard :math:`\tau_i = T_i - T_0` later,

    .. math:: c T_i = |p_i + v_i \tau_i + a_i \tau_i^2/2 - x_e|.

    With the directions :math:`n_i` of that path and the velocities of its two ends *then*,
    :math:`v_e = v - a T_0` and :math:`u_i = v_i + a_i \tau_i`, the ratio of received and emitted frequency is the
    derivative of emission by reception time, :math:`(c - n_i u_i)/(c - n_i v_e)`. In low orbit :math:`a_i\tau_i`, 8
    m/s^2 over 0.3 ms, is a sixth of what light time changes in the FDOA. The derivatives are by implicit
    differentiation.

    Parameters
    ----------
    target : ndarray, shape (..., n)
        Earth-fixed position [m] and velocity [m/s] first.
    platforms : ndarray, shape (..., p, 6)
        The same of the receivers.
    reference : int
        The receiver that sets the instant.
    earth_rate : float
        Rotation of the Earth-fixed axes about z [rad/s].
    constants : GravityConstants, optional
        Gravity in which receivers fall that are `in_orbit`.

    Returns
    -------
    Arrival
    """
    spin = earth_rate * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    x = target[..., :3]
    v = target[..., 3:6] + np.einsum("ij,...j->...i", spin, x)
    a = np.einsum("ij,...j->...i", spin, v + target[..., 3:6])
    p = platforms[..., :3]
    vp = platforms[..., 3:6] + np.einsum("ij,...j->...i", spin, p)
    ap = _platform_acceleration(platforms, vp, spin, constants or GravityConstants())

    t0, path0, ve = _travel_time(p[..., reference, :] - x, v, -a, 0.0)
    emitted = x - v * t0[..., None] + a * (0.5 * t0[..., None] ** 2)
    t, path, u = _travel_time(p - emitted[..., None, :], vp, ap, t0[..., None, None])
    n0, n = path0 / (SPEED_OF_LIGHT * t0)[..., None], path / (SPEED_OF_LIGHT * t)[..., None]
    return Arrival(t0, n0, ve, a, t, n, u, ap, spin)
