"""Exact arrival of one wave front at several moving receivers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from systems.measurement.base import SPEED_OF_LIGHT

__all__ = ["EARTH_RATE", "Arrival", "arrival"]

Array = NDArray[np.float64]

EARTH_RATE = 7.292115e-5
"""Rotation rate of the Earth [rad/s]."""


@dataclass(frozen=True)
class Arrival:
    """How one wave front reaches p receivers; derivatives are with respect to (position, velocity).

    Attributes
    ----------
    delay, delay_jacobian : ndarray, shape (..., p) and (..., p, 6)
        Arrival after the arrival at the reference [s].
    frequency_ratio, frequency_ratio_jacobian : ndarray, shape (..., p) and (..., p, 6)
        Received over emitted frequency, minus 1.
    """

    delay: Array
    delay_jacobian: Array
    frequency_ratio: Array
    frequency_ratio_jacobian: Array


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...i,...i->...", a, b)


def _travel_time(offset: Array, velocity: Array) -> Array:
    """Solve ``c t = |offset + velocity t|`` for t > 0 without cancellation."""
    closing = _dot(offset, velocity)
    square = _dot(offset, offset)
    slack = SPEED_OF_LIGHT**2 - _dot(velocity, velocity)
    return (closing + np.sqrt(closing**2 + slack * square)) / slack


def arrival(target: Array, platforms: Array, reference: int, earth_rate: float = EARTH_RATE) -> Arrival:
    r"""Follow one wave front from the emitter to every receiver.

    The front reaches the reference at the instant for which `target` and `platforms` are given. In inertial axes
    that coincide with the Earth-fixed ones at that instant, with velocities :math:`v + \omega\times p` held over the
    light time, the travel time to the reference solves :math:`c T_0 = |p_0 - x + v T_0|` and that to receiver i
    :math:`c T_i = |p_i - x + v T_0 + v_i (T_i - T_0)|`; both are quadratic. The derivatives come from implicit
    differentiation; the Doppler ratio is :math:`(c - n_i v_i)/(c - n_i v)`.

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

    Returns
    -------
    Arrival
    """
    spin = earth_rate * np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    x = target[..., :3]
    v = target[..., 3:6] + np.einsum("ij,...j->...i", spin, x)
    p = platforms[..., :3]
    vp = platforms[..., 3:6] + np.einsum("ij,...j->...i", spin, p)
    c = SPEED_OF_LIGHT

    offset0 = p[..., reference, :] - x
    t0 = _travel_time(offset0, v)
    n0 = (offset0 + v * t0[..., None]) / (c * t0)[..., None]
    # Columns of d(x), d(v) in terms of the Earth-fixed state: v depends on the position through the spin.
    dx = np.concatenate([np.eye(3), np.zeros((3, 3))], axis=1)
    dv = np.concatenate([spin, np.eye(3)], axis=1)
    dt0 = np.einsum("...i,...ij->...j", n0, t0[..., None, None] * dv - dx) / (c - _dot(n0, v))[..., None]

    emitted = x - v * t0[..., None]
    offset = p - vp * t0[..., None, None] - emitted[..., None, :]
    t = _travel_time(offset, vp)
    w = offset + vp * t[..., None]
    distance = c * t
    n = w / distance[..., None]
    v_wide = v[..., None, :]
    demitted = dx - t0[..., None, None] * dv - v[..., :, None] * dt0[..., None, :]
    fixed = -demitted[..., None, :, :] - vp[..., :, None] * dt0[..., None, None, :]
    dt = np.einsum("...i,...ij->...j", n, fixed) / (c - _dot(n, vp))[..., None]

    up, away = _dot(n, vp), _dot(n, v_wide)
    ratio = (away - up) / (c - away)
    dw = fixed + vp[..., :, None] * dt[..., None, :]
    dn = (dw - n[..., :, None] * np.einsum("...i,...ij->...j", n, dw)[..., None, :]) / distance[..., None, None]
    dup = np.einsum("...i,...ij->...j", vp, dn)
    daway = np.einsum("...i,...ij->...j", v_wide, dn) + np.einsum("...i,ij->...j", n, dv)
    dratio = (daway - dup) / (c - away)[..., None] + (ratio / (c - away))[..., None] * daway
    return Arrival(t - t0[..., None], dt - dt0[..., None, :], ratio, dratio)
