"""Gravity of the Earth: two-body and J2, over leading axes, in inertial axes with z along the pole.

The J2 term is the same about any axis through the pole, so these functions serve Earth-fixed positions as
well (the result is then the inertial acceleration in Earth-fixed axes).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.systems.constants import EARTH_MU, EARTH_RATE, WGS84_AXIS, WGS84_ECCENTRICITY_SQUARED

__all__ = ["GravityConstants", "above_surface", "acceleration", "energy", "gradient", "gradient_rate"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GravityConstants:
    """Constants of the Earth.

    Parameters
    ----------
    mu : float
        Gravitational parameter [m^3/s^2], > 0.
    radius : float
        Equatorial radius [m], > 0.
    j2 : float
        Second zonal harmonic, not normalised, >= 0.
    earth_rate : float
        Rotation rate of the Earth [rad/s].

    Raises
    ------
    ValueError
        If a value is not finite or not allowed.
    """

    mu: float = EARTH_MU
    radius: float = WGS84_AXIS
    j2: float = 1.0826261e-3
    earth_rate: float = EARTH_RATE

    def __post_init__(self) -> None:
        """Check the arguments."""
        for field in fields(self):
            value = getattr(self, field.name)
            if not math.isfinite(value):
                raise ValueError(f"{field.name}: {value} is not allowed; it must be finite")
        if self.mu <= 0:
            raise ValueError(f"mu: {self.mu} is not allowed; it must be > 0 m^3/s^2")
        if self.radius <= 0:
            raise ValueError(f"radius: {self.radius} is not allowed; it must be > 0 m")
        if self.j2 < 0:
            raise ValueError(f"j2: {self.j2} is not allowed; it must be >= 0")


def acceleration(position: ArrayLike, constants: GravityConstants, j2: bool = True) -> Array:
    """Return the acceleration of gravity.

    Parameters
    ----------
    position : array_like, shape (..., 3)
        Position from the centre of the Earth, z along the pole [m].
    constants : GravityConstants
        Constants of the Earth.
    j2 : bool
        Whether the flattening of the Earth acts.

    Returns
    -------
    ndarray, shape (..., 3)
        Inertial acceleration [m/s^2].

    Notes
    -----
    The gradient of U = mu/r [1 - J2 (R/r)^2 (3 s^2 - 1)/2], s = z/r (Vallado, *Fundamentals of
    Astrodynamics and Applications*, 4th ed., section 8.6).
    """
    p = np.asarray(position, dtype=float)
    square = (p * p).sum(axis=-1, keepdims=True)
    pull = -constants.mu / (square * np.sqrt(square))
    if not j2:
        return pull * p
    bulge = 1.5 * constants.j2 * constants.radius**2 / square
    out = pull * (1 + bulge * (1 - 5 * p[..., 2:3] ** 2 / square)) * p
    out[..., 2:3] += 2 * pull * bulge * p[..., 2:3]
    return out


def gradient(position: ArrayLike, constants: GravityConstants, j2: bool = True) -> Array:
    """Return the derivative of `acceleration` with respect to the position.

    Parameters
    ----------
    position : array_like, shape (..., 3)
        Position from the centre of the Earth, z along the pole [m].
    constants : GravityConstants
        Constants of the Earth.
    j2 : bool
        Whether the flattening of the Earth acts.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        Symmetric and without trace [1/s^2].
    """
    p = np.asarray(position, dtype=float)
    square = (p * p).sum(axis=-1)[..., None, None]
    pull = constants.mu / (square * np.sqrt(square))
    along = p / np.sqrt(square[..., 0])
    outer = along[..., :, None] * along[..., None, :]
    out = pull * (3 * outer - np.eye(3))
    if not j2:
        return out
    sine = along[..., 2][..., None, None]
    pole = np.zeros_like(outer)
    pole[..., 2, :] = along
    mixed = pole + np.swapaxes(pole, -1, -2)
    flat = (5 * sine**2 - 1) * np.eye(3) + (5 - 35 * sine**2) * outer + 10 * sine * mixed - 2 * np.diag([0.0, 0.0, 1.0])
    return out + 1.5 * constants.j2 * constants.radius**2 * pull / square * flat


def gradient_rate(position: ArrayLike, velocity: ArrayLike, constants: GravityConstants, j2: bool = True) -> Array:
    """Return how fast `gradient` changes for a body that moves.

    Parameters
    ----------
    position : array_like, shape (..., 3)
        Position from the centre of the Earth, z along the pole [m].
    velocity : array_like, shape (..., 3)
        Velocity [m/s].
    constants : GravityConstants
        Constants of the Earth.
    j2 : bool
        Whether the flattening of the Earth acts.

    Returns
    -------
    ndarray, shape (..., 3, 3)
        dG/dt [1/s^3]; third derivatives of a potential commute, so it is the derivative of G v with respect to the
        position as well.
    """
    p, v = np.asarray(position, dtype=float), np.asarray(velocity, dtype=float)
    radius = np.sqrt((p * p).sum(axis=-1, keepdims=True))
    along = p / radius
    climb = (along * v).sum(axis=-1, keepdims=True)
    turn = (v - climb * along) / radius
    growth = (climb / radius)[..., None]
    outer = along[..., :, None] * along[..., None, :]
    mixed = turn[..., :, None] * along[..., None, :]
    turning = mixed + np.swapaxes(mixed, -1, -2)
    pull = constants.mu / radius[..., None] ** 3
    out = 3 * pull * (turning - growth * (3 * outer - np.eye(3)))
    if not j2:
        return out
    sine, rate = along[..., 2, None, None], turn[..., 2, None, None]
    pole, pole_rate = np.zeros_like(outer), np.zeros_like(outer)
    pole[..., 2, :], pole_rate[..., 2, :] = along, turn
    both = pole + np.swapaxes(pole, -1, -2)
    both_rate = pole_rate + np.swapaxes(pole_rate, -1, -2)
    eye, axis = np.eye(3), np.diag([0.0, 0.0, 1.0])
    flat = (5 * sine**2 - 1) * eye + (5 - 35 * sine**2) * outer + 10 * sine * both - 2 * axis
    flat_rate = (
        10 * sine * rate * eye
        - 70 * sine * rate * outer
        + (5 - 35 * sine**2) * turning
        + 10 * (rate * both + sine * both_rate)
    )
    bulge = 1.5 * constants.j2 * constants.radius**2 * pull / radius[..., None] ** 2
    return out + bulge * (flat_rate - 5 * growth * flat)


def energy(state: ArrayLike, constants: GravityConstants, j2: bool = True) -> Array:
    """Return the energy per mass, which an orbit conserves.

    Parameters
    ----------
    state : array_like, shape (..., 6)
        Inertial position [m] and velocity [m/s].
    constants : GravityConstants
        Constants of the Earth.
    j2 : bool
        Whether the flattening of the Earth acts.

    Returns
    -------
    ndarray, shape (...)
        v^2/2 - U [m^2/s^2], U as in `acceleration`.
    """
    x = np.asarray(state, dtype=float)
    square = (x[..., :3] ** 2).sum(axis=-1)
    potential = constants.mu / np.sqrt(square)
    if j2:
        potential = potential * (
            1 - constants.j2 * constants.radius**2 / square * (1.5 * x[..., 2] ** 2 / square - 0.5)
        )
    return 0.5 * (x[..., 3:6] ** 2).sum(axis=-1) - potential


def above_surface(position: ArrayLike, constants: GravityConstants, depth: float = 0.0) -> NDArray[np.bool_]:
    """Return whether positions lie above the Earth: WGS-84's shape with ``constants.radius``.

    Parameters
    ----------
    position : array_like, shape (..., 3)
        Position from the centre of the Earth [m].
    constants : GravityConstants
        Constants of the Earth.
    depth : float
        How far below the surface still counts as above [m].

    Returns
    -------
    ndarray of bool, shape (...)
        False where a component is not finite.
    """
    p = np.asarray(position, dtype=float)
    axis = constants.radius - depth
    square = (p[..., :2] ** 2).sum(axis=-1) + p[..., 2] ** 2 / (1 - WGS84_ECCENTRICITY_SQUARED)
    # a geodetic point at height 0 misses the ellipsoid by rounding
    return square >= axis**2 * (1 - 1e-14)
