"""Motion of a satellite in inertial axes, two-body or with J2."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.equations import Step, step
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.trajectories.gravity import GravityConstants, acceleration, gradient, gradient_rate

__all__ = ["OrbitalMotion", "Propagation"]

Array = NDArray[np.float64]
Propagation = Literal["runge_kutta", "second_order"]


@lru_cache(maxsize=64)
def _noise(dt: float, density: float) -> Array:
    q = density * np.kron(np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]), np.eye(3))
    q.setflags(write=False)
    return q


@lru_cache(maxsize=64)
def _step(h: float, count: int, mu: float, flat: float, dt: float, density: float) -> Step:
    return step(["motion:orbital"], [(h, count, mu, flat)], _noise(dt, density))


class OrbitalMotion(MotionModel):
    r"""Free fall in the gravity of the Earth, with white acceleration noise.

    ``runge_kutta``: classical fourth order in equal steps of at most `step`, and the derivative of that very map
    (which is the same scheme on the variational equations :math:`\dot\Phi = A\Phi`); 10 mm after 5000 s in steps of
    10 s. ``second_order``: the Taylor step of Wu, Xin and Wan, eq. (42),

    .. math:: x^+ = x + F T + A F\,T^2/2, \qquad \Phi = I + A T + (A^2 + \dot A)\,T^2/2

    with (43) corrected: the paper prints a factor 1/4 and A for its derivative. It is 1.2 m off after one step of 10 s.

    Parameters
    ----------
    constants : GravityConstants, optional
        Constants of the Earth.
    j2 : bool
        Whether the flattening of the Earth acts.
    method : {'runge_kutta', 'second_order'}
        See above.
    step : float
        Longest step of the Runge-Kutta scheme [s], > 0.
    density : float
        Power spectral density of the acceleration noise per axis [m^2/s^3], >= 0.
    """

    names = ("x", "y", "z", "vx", "vy", "vz")
    units = ("m", "m", "m", "m/s", "m/s", "m/s")

    def __init__(
        self,
        constants: GravityConstants | None = None,
        j2: bool = True,
        method: Propagation = "runge_kutta",
        step: float = 10.0,
        density: float = 0.0,
    ) -> None:
        if method not in ("runge_kutta", "second_order"):
            raise ValueError(f"propagation: {method} is not allowed; runge_kutta or second_order")
        if not (math.isfinite(step) and step > 0):
            raise ValueError(f"propagation step: {step} is not allowed; it must be > 0 s")
        if not (math.isfinite(density) and density >= 0):
            raise ValueError(f"acceleration density: {density} is not allowed; it must be >= 0 m^2/s^3")
        self.constants = constants or GravityConstants()
        self.j2 = bool(j2)
        self.method = method
        self.step = float(step)
        self.density = float(density)

    def equations(self, dt: float) -> Step | None:
        """See `MotionModel.equations`; those of `runge_kutta`."""
        if self.method != "runge_kutta":
            return None
        flat = 1.5 * self.constants.j2 * self.constants.radius**2 if self.j2 else 0.0
        count = self._steps(dt)
        return _step(dt / count, count, self.constants.mu, flat, float(dt), self.density)

    def propagate(self, state: Array, dt: float) -> Array:
        """See `MotionModel.propagate`."""
        x = np.asarray(state, dtype=float)
        if self.method == "second_order":
            a = acceleration(x[..., :3], self.constants, self.j2)
            pull = gradient(x[..., :3], self.constants, self.j2)
            jerk = np.einsum("...ij,...j->...i", pull, x[..., 3:6])
            rate, curve = np.concatenate([x[..., 3:6], a], axis=-1), np.concatenate([a, jerk], axis=-1)
            return x + dt * rate + 0.5 * dt**2 * curve
        count = self._steps(dt)
        for _ in range(count):
            x = self._rk4(x, dt / count)
        return x

    def transition(self, state: Array, dt: float) -> Array:
        """See `MotionModel.transition`."""
        x = np.asarray(state, dtype=float)
        if self.method == "second_order":
            pull = gradient(x[..., :3], self.constants, self.j2)
            change = gradient_rate(x[..., :3], x[..., 3:6], self.constants, self.j2)
            phi = np.empty((*x.shape[:-1], 6, 6))
            half, eye = 0.5 * dt**2, np.eye(3)
            phi[..., :3, :3] = phi[..., 3:, 3:] = eye + half * pull
            phi[..., :3, 3:] = dt * eye
            phi[..., 3:, :3] = dt * pull + half * change
            return phi
        count = self._steps(dt)
        phi = np.broadcast_to(np.eye(6), (*x.shape[:-1], 6, 6))
        for i in range(count):
            phi = self._rk4_transition(x, dt / count, phi)
            x = self._rk4(x, dt / count) if i + 1 < count else x
        return phi

    def process_noise(self, state: Array, dt: float) -> Array:
        """See `MotionModel.process_noise`; white acceleration on a straight line, shape (6, 6)."""
        return _noise(float(dt), self.density)

    def _steps(self, dt: float) -> int:
        return max(1, math.ceil(abs(dt) / self.step * (1 - 1e-12)))

    def _rk4(self, x: Array, h: float) -> Array:
        p, v = x[..., :3], x[..., 3:6]
        a1 = acceleration(p, self.constants, self.j2)
        v2 = v + 0.5 * h * a1
        a2 = acceleration(p + 0.5 * h * v, self.constants, self.j2)
        v3 = v + 0.5 * h * a2
        a3 = acceleration(p + 0.5 * h * v2, self.constants, self.j2)
        v4 = v + h * a3
        a4 = acceleration(p + h * v3, self.constants, self.j2)
        moved = np.empty_like(x)
        moved[..., :3] = p + h / 6 * (v + 2 * v2 + 2 * v3 + v4)
        moved[..., 3:6] = v + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        return moved

    def _rk4_transition(self, x: Array, h: float, phi: Array) -> Array:
        """Return the derivative of `_rk4` times `phi`: the stages differentiated one by one."""
        p, v = x[..., :3], x[..., 3:6]
        dp, dv = phi[..., :3, :], phi[..., 3:, :]

        def pull(position: Array, change: Array) -> Array:
            return gradient(position, self.constants, self.j2) @ change

        a1 = acceleration(p, self.constants, self.j2)
        a2 = acceleration(p + 0.5 * h * v, self.constants, self.j2)
        v2, v3 = v + 0.5 * h * a1, v + 0.5 * h * a2
        da1 = pull(p, dp)
        dv2 = dv + 0.5 * h * da1
        da2 = pull(p + 0.5 * h * v, dp + 0.5 * h * dv)
        dv3 = dv + 0.5 * h * da2
        da3 = pull(p + 0.5 * h * v2, dp + 0.5 * h * dv2)
        dv4 = dv + h * da3
        da4 = pull(p + h * v3, dp + h * dv3)
        moved = np.empty((*x.shape[:-1], 6, phi.shape[-1]))
        moved[..., :3, :] = dp + h / 6 * (dv + 2 * dv2 + 2 * dv3 + dv4)
        moved[..., 3:, :] = dv + h / 6 * (da1 + 2 * da2 + 2 * da3 + da4)
        return moved
