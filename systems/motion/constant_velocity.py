"""Constant velocity with random accelerations."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.motion.base import MotionModel

__all__ = ["ConstantVelocity", "WhiteNoiseAcceleration"]

Array = NDArray[np.float64]

_AXES = "xyz"


@lru_cache(maxsize=256)
def _transition(axes: int, dt: float) -> Array:
    phi = np.eye(2 * axes)
    phi[:axes, axes:] = dt * np.eye(axes)
    phi.setflags(write=False)
    return phi


@lru_cache(maxsize=256)
def _noise(axes: int, pp: float, pv: float, vv: float) -> Array:
    q = np.kron(np.array([[pp, pv], [pv, vv]]), np.eye(axes))
    q.setflags(write=False)
    return q


class _StraightLine(MotionModel):
    linear = True

    def __init__(self, axes: int) -> None:
        if axes not in (1, 2, 3):
            raise ValueError(f"axes: {axes} is not allowed; 1, 2 or 3")
        self.axes = axes
        self.names = tuple(_AXES[:axes]) + tuple("v" + a for a in _AXES[:axes])
        self.units = ("m",) * axes + ("m/s",) * axes

    def propagate(self, state: Array, dt: float) -> Array:
        """Return ``[p + v dt, v]``."""
        moved = np.array(state, dtype=float)
        moved[..., : self.axes] += dt * moved[..., self.axes :]
        return moved

    def transition(self, state: Array, dt: float) -> Array:
        """Return ``[[I, dt I], [0, I]]``, shape (n, n)."""
        return _transition(self.axes, float(dt))


class ConstantVelocity(_StraightLine):
    r"""Constant velocity, with an acceleration that is constant within each step.

    .. math:: Q = \sigma_a^2 \begin{bmatrix} dt^4/4\,I & dt^3/2\,I \\ dt^3/2\,I & dt^2\,I \end{bmatrix}

    Equation (3) of Xu, Su and Wang, doi 10.20079/j.issn.1001-893x.220609005 (there :math:`\sigma_v`; it is an
    acceleration). Q has rank `axes`, and one step of 2 s has more of it than two of 1 s: for irregular sampling
    use `WhiteNoiseAcceleration`.

    Parameters
    ----------
    acceleration : float
        Standard deviation of the acceleration per axis [m/s^2], >= 0.
    axes : int
        Number of space dimensions.
    """

    def __init__(self, acceleration: float, axes: int = 3) -> None:
        super().__init__(axes)
        if not (math.isfinite(acceleration) and acceleration >= 0):
            raise ValueError(f"acceleration: {acceleration} is not allowed; it must be >= 0 m/s^2")
        self.acceleration = float(acceleration)

    def process_noise(self, state: Array, dt: float) -> Array:
        """Return Q, shape (n, n)."""
        a2 = self.acceleration**2
        return _noise(self.axes, a2 * dt**4 / 4, a2 * dt**3 / 2, a2 * dt**2)


class WhiteNoiseAcceleration(_StraightLine):
    r"""Constant velocity driven by white acceleration noise.

    .. math:: Q = \tilde q \begin{bmatrix} dt^3/3\,I & dt^2/2\,I \\ dt^2/2\,I & dt\,I \end{bmatrix}

    Additive over time: two steps of 1 s equal one of 2 s. Bar-Shalom, Li and Kirubarajan, *Estimation with
    Applications to Tracking and Navigation*, Wiley 2001, eq. (6.2.2-12).

    Parameters
    ----------
    density : float
        Power spectral density of the acceleration per axis [m^2/s^3], >= 0.
    axes : int
        Number of space dimensions.
    """

    def __init__(self, density: float, axes: int = 3) -> None:
        super().__init__(axes)
        if not (math.isfinite(density) and density >= 0):
            raise ValueError(f"density: {density} is not allowed; it must be >= 0 m^2/s^3")
        self.density = float(density)

    def process_noise(self, state: Array, dt: float) -> Array:
        """Return Q, shape (n, n)."""
        return _noise(self.axes, self.density * dt**3 / 3, self.density * dt**2 / 2, self.density * dt)
