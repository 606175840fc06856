"""A turn of known rate about the vertical."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.motion.base import MotionModel

__all__ = ["CoordinatedTurn"]

Array = NDArray[np.float64]

_SMALL = 0.1  # rad; below it the series of theta - sin(theta) is to the last bit, above it the difference nearly is


def _lag(angle: float) -> float:
    """Return theta - sin(theta)."""
    if abs(angle) > _SMALL:
        return angle - math.sin(angle)
    square = angle * angle
    return angle * square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72 * (1 - square / 110))))


@lru_cache(maxsize=256)
def _matrices(axes: int, rate: float, density: float, dt: float) -> tuple[Array, Array]:
    angle = rate * dt
    sine, versine = math.sin(angle), 2 * math.sin(angle / 2) ** 2
    phi, q = np.eye(2 * axes), np.zeros((2 * axes, 2 * axes))
    x, v = slice(0, 2), slice(axes, axes + 2)
    phi[x, v] = np.array([[sine, -versine], [versine, sine]]) / rate
    phi[v, v] = [[1 - versine, -sine], [sine, 1 - versine]]
    a, b = versine / rate**2, _lag(angle) / rate**2
    q[x, x] = 2 * b / rate * np.eye(2)
    q[x, v] = [[a, b], [-b, a]]
    q[v, x] = q[x, v].T
    q[v, v] = dt * np.eye(2)
    if axes == 3:
        phi[2, 5] = dt
        q[2, 2], q[2, 5], q[5, 2], q[5, 5] = dt**3 / 3, dt**2 / 2, dt**2 / 2, dt
    q *= density
    for matrix in (phi, q):
        matrix.setflags(write=False)
    return phi, q


class CoordinatedTurn(MotionModel):
    r"""The horizontal velocity turns at a known rate, driven by white acceleration noise; upwards it is straight.

    .. math:: \dot v = \omega\,\hat z \times v + w, \qquad
        \Phi_{xv} = \frac1\omega \begin{bmatrix} \sin\theta & -(1 - \cos\theta) \\ 1 - \cos\theta & \sin\theta
        \end{bmatrix}, \qquad \Phi_{vv} = \begin{bmatrix} \cos\theta & -\sin\theta \\ \sin\theta & \cos\theta
        \end{bmatrix}, \qquad \theta = \omega\,dt

    Bar-Shalom, Li and Kirubarajan, *Estimation with Applications to Tracking and Navigation*, 2001, section 11.7.1. The
    noise is integrated along the turn, :math:`Q = \tilde q \int_0^{dt} \Phi(s) G G^T \Phi(s)^T ds`, in closed form:

    .. math:: Q_{xx} = \tilde q\,\frac{2(\theta - \sin\theta)}{\omega^3} I, \qquad
        Q_{xv} = \frac{\tilde q}{\omega^2} \begin{bmatrix} 1 - \cos\theta & \theta - \sin\theta \\
        -(\theta - \sin\theta) & 1 - \cos\theta \end{bmatrix}, \qquad Q_{vv} = \tilde q\,dt\,I

    so that two steps of 1 s equal one of 2 s, and a rate towards 0 gives `WhiteNoiseAcceleration`.

    Parameters
    ----------
    rate : float
        omega [rad/s], positive to the left (counter-clockwise as seen from above), not 0.
    density : float
        Power spectral density of the acceleration per axis [m^2/s^3], >= 0.
    axes : int
        2, or 3 with the third upwards.
    """

    linear = True

    def __init__(self, rate: float, density: float, axes: int = 3) -> None:
        if not (math.isfinite(rate) and rate != 0):
            raise ValueError(f"rate: {rate} is not allowed; it must be a finite number other than 0 rad/s")
        if not (math.isfinite(density) and density >= 0):
            raise ValueError(f"density: {density} is not allowed; it must be >= 0 m^2/s^3")
        if axes not in (2, 3):
            raise ValueError(f"axes: {axes} is not allowed; 2 or 3")
        self.rate, self.density, self.axes = float(rate), float(density), axes
        self.names = tuple("xyz"[:axes]) + tuple("v" + a for a in "xyz"[:axes])
        self.units = ("m",) * axes + ("m/s",) * axes

    def propagate(self, state: Array, dt: float) -> Array:
        """See `MotionModel.propagate`."""
        return np.einsum("ij,...j->...i", self.transition(state, dt), state)

    def transition(self, state: Array, dt: float) -> Array:
        """See `MotionModel.transition`; shape (n, n)."""
        return _matrices(self.axes, self.rate, self.density, float(dt))[0]

    def process_noise(self, state: Array, dt: float) -> Array:
        """See `MotionModel.process_noise`; shape (n, n)."""
        return _matrices(self.axes, self.rate, self.density, float(dt))[1]
