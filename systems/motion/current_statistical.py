"""The "current" statistical model: a Singer model whose mean acceleration follows the estimate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from quietfix.systems.kernels.equations import Step, step
from quietfix.systems.motion.base import MotionModel

__all__ = ["CurrentStatistical", "MeanAcceleration", "singer_input", "singer_noise", "singer_transition"]

Array = NDArray[np.float64]
MeanAcceleration = Literal["estimate", "filtered"]

_SMALL = 1.0  # alpha * dt below which power series replace the closed forms, which cancel
_TERMS = 28  # 2**28 / 28! is below 1e-21


def _phi(order: int, x: float) -> float:
    r"""Return :math:`\varphi_k(x) = \sum_n (-x)^n/(n+k)!`, so that :math:`\varphi_0 = e^{-x}`."""
    if x < _SMALL:
        return math.fsum((-x) ** n / math.factorial(n + order) for n in range(_TERMS))
    value = math.exp(-x)
    for k in range(order):
        value = (1 / math.factorial(k) - value) / x
    return value


def _bracket(x: float, first: int, closed: float, coefficient: tuple[float, float, float]) -> float:
    """Return ``closed / (2 x**first)``, by its series where it cancels.

    The bracket is a combination ``a exp(-2x) + b exp(-x) + c x exp(-x)`` and a polynomial that removes the terms
    below ``x**first``; `coefficient` holds a, b and c.
    """
    if x >= _SMALL:
        return closed / (2 * x**first)
    a, b, c = coefficient
    return 0.5 * math.fsum(
        (
            a * (-2.0) ** n / math.factorial(n)
            + b * (-1.0) ** n / math.factorial(n)
            + c * (-1.0) ** (n - 1) / math.factorial(n - 1)
        )
        * x ** (n - first)
        for n in range(first, first + _TERMS)
    )


def _check(alpha: float, dt: float) -> float:
    if not (math.isfinite(alpha) and alpha > 0):
        raise ValueError(f"alpha: {alpha} is not allowed; the manoeuvre frequency must be a finite number > 0 1/s")
    return alpha * dt


def singer_transition(alpha: float, dt: float) -> Array:
    r"""Return the transition of (position, velocity, acceleration) of one axis, shape (3, 3).

    Parameters
    ----------
    alpha : float
        Manoeuvre frequency [1/s], > 0.
    dt : float
        Step [s], >= 0.

    Raises
    ------
    ValueError
        If alpha is not > 0.
    """
    x = _check(alpha, dt)
    return np.array([[1.0, dt, dt**2 * _phi(2, x)], [0.0, 1.0, dt * _phi(1, x)], [0.0, 0.0, math.exp(-x)]])


def singer_input(alpha: float, dt: float) -> Array:
    r"""Return what a unit of mean acceleration adds to (position, velocity, acceleration), shape (3,).

    With :func:`singer_transition` 's last column it sums to :math:`(dt^2/2, dt, 1)`: a mean acceleration equal to
    the estimate makes the prediction one of constant acceleration.
    """
    x = _check(alpha, dt)
    return np.array([dt**2 * x * _phi(3, x), dt * x * _phi(2, x), -math.expm1(-x)])


def singer_noise(alpha: float, dt: float) -> Array:
    r"""Return :math:`[q_{ij}] = \int_0^{dt} g\,g^T ds`, g the response to a unit of jerk, shape (3, 3).

    .. math:: g(s) = [(\alpha s - 1 + e^{-\alpha s})/\alpha^2,\ (1 - e^{-\alpha s})/\alpha,\ e^{-\alpha s}]^T

    The process noise of one axis is :math:`2\alpha\sigma^2 [q_{ij}]`. Singer, IEEE Trans. AES-6 (1970) 473; Li and
    Jilkov, IEEE Trans. AES-39 (2003) 1333, part I.

    Notes
    -----
    The closed forms lose all digits where alpha dt is small: at 5e-4 the bracket of q11 is 3e-18, less than the
    rounding of its terms. Below alpha dt = 1 their power series are summed instead.
    """
    x = _check(alpha, dt)
    e, e2 = math.exp(-x), math.exp(-2 * x)
    q11 = _bracket(x, 5, 1 - e2 + 2 * x + 2 * x**3 / 3 - 2 * x**2 - 4 * x * e, (-1, 0, -4))
    q12 = _bracket(x, 4, e2 + 1 - 2 * e + 2 * x * e - 2 * x + x**2, (1, -2, 2))
    q13 = _bracket(x, 3, 1 - e2 - 2 * x * e, (-1, 0, -2))
    q22 = _bracket(x, 3, 4 * e - 3 - e2 + 2 * x, (-1, 4, 0))
    q23 = _bracket(x, 2, e2 + 1 - 2 * e, (1, -2, 0))
    q33 = _bracket(x, 1, 1 - e2, (-1, 0, 0))
    t = np.array([dt**2, dt, 1.0])
    return dt * np.outer(t, t) * np.array([[q11, q12, q13], [q12, q22, q23], [q13, q23, q33]])


@lru_cache(maxsize=64)
def _matrices(alpha: float, dt: float, biases: int) -> tuple[Array, Array, Array, Array]:
    """Return transition, input (n, 3), noise of a unit variance per axis (3, n, n), constant acceleration (n, n)."""
    n = 9 + biases
    transition = np.eye(n)
    transition[:9, :9] = np.kron(singer_transition(alpha, dt), np.eye(3))
    entering = np.zeros((n, 3))
    entering[:9] = np.kron(singer_input(alpha, dt)[:, None], np.eye(3))
    noise = np.zeros((3, n, n))
    q = 2 * alpha * singer_noise(alpha, dt)
    for axis in range(3):
        noise[axis, axis:9:3, axis:9:3] = q
    free = np.eye(n)
    free[:9, :9] = np.kron([[1.0, dt, dt**2 / 2], [0.0, 1.0, dt], [0.0, 0.0, 1.0]], np.eye(3))
    for array in (transition, entering, noise, free):
        array.setflags(write=False)
    return transition, entering, noise, free


@lru_cache(maxsize=64)
def _step(alpha: float, dt: float, limits: tuple[float, ...], densities: tuple[float, ...]) -> Step:
    transition, entering = singer_transition(alpha, dt), singer_input(alpha, dt)
    q = 2 * alpha * singer_noise(alpha, dt)
    moving = [dt, transition[0, 2], transition[1, 2], transition[2, 2], *entering]
    spreading = [*q[np.triu_indices(3)], *limits, *(dt * density for density in densities)]
    n = 9 + len(densities)
    kernels = ("motion:current_statistical", "motion:current_statistical_noise")
    return step(kernels, (moving, spreading), np.zeros((n, n)))


class CurrentStatistical(MotionModel):
    r"""Accelerations that fluctuate about a mean which follows the estimate, and biases that walk at random.

    State: x, y, z, vx, vy, vz, ax, ay, az, then the biases (Shang, Xing and Gan, *Real-time processing of tracking
    data of maneuvering target in beacon-mode*, Control Theory & Applications 29 (2012) 59, interleave the axes; here
    position and velocity come first as everywhere).

    .. math:: X_{k+1} = \Phi X_k + U \bar a_k + W_k, \qquad Q_i = 2\alpha\sigma_i^2 [q], \qquad
              \sigma_i^2 = \frac{4-\pi}{\pi}\,(a_{i,\pm\max} - \bar a_i)^2

    with :math:`a_{i,\max}` where :math:`\bar a_i \ge 0`, else :math:`a_{i,-\max}` (the paper leaves 0 out).

    Parameters
    ----------
    alpha : float
        Manoeuvre frequency [1/s], > 0.
    largest, smallest : array_like, shape (3,)
        Largest (>= 0) and smallest (<= 0) acceleration per axis [m/s^2].
    floor : float
        Least sigma [m/s^2], >= 0. Without one the model is blind exactly where the mean reaches its limit, which is
        at burn-out, a moment before the acceleration jumps.
    bias_densities : sequence of float
        Power spectral density of the rate of each bias [(m/s)^2/s], >= 0; none means a state of nine.
    rule : {'estimate', 'filtered'}
        Mean acceleration: the estimate of the acceleration, or equation (9) of the paper,
        :math:`\bar a_{k+1} = e^{-\alpha T}\hat a_k + (1 - e^{-\alpha T})\bar a_k`.
    mean : array_like, shape (..., 3), optional
        The mean acceleration as an input that is held (`driven`). By default it is read off the state.

    Raises
    ------
    ValueError
        For alpha, limits, floor or densities that are not allowed.

    Notes
    -----
    An estimator holds the mean acceleration as a known input, as the paper does: it carries the input from step to step
    (`next_input`) and predicts with `driven`, whose transition is :math:`\Phi`. The model by itself reads the mean off
    the state, which makes the motion one of constant acceleration and `transition` that of it: what a plant and a bound
    need, for which nobody holds an input.
    """

    linear = True

    def __init__(
        self,
        alpha: float,
        largest: ArrayLike,
        smallest: ArrayLike,
        floor: float = 0.0,
        bias_densities: Sequence[float] = (),
        rule: MeanAcceleration = "estimate",
        mean: ArrayLike | None = None,
    ) -> None:
        _check(alpha, 0.0)
        self.alpha = float(alpha)
        self.largest, self.smallest = np.array(largest, dtype=float), np.array(smallest, dtype=float)
        for name, limit, wrong in (("a_max", self.largest, -1), ("a_min", self.smallest, 1)):
            if limit.shape != (3,) or not np.all(np.isfinite(limit)):
                raise ValueError(f"{name}: {limit.tolist()} is not allowed; three finite numbers [m/s^2]")
            if np.any(np.sign(limit) == wrong):
                side = ">= 0" if wrong < 0 else "<= 0"
                raise ValueError(f"{name}: {limit.tolist()} is not allowed; every axis must be {side} m/s^2")
        if not (math.isfinite(floor) and floor >= 0):
            raise ValueError(f"sigma floor: {floor} is not allowed; it must be >= 0 m/s^2")
        if any(not (math.isfinite(q) and q >= 0) for q in bias_densities):
            raise ValueError(f"bias density: {list(bias_densities)} is not allowed; all must be >= 0 (m/s)^2/s")
        if rule not in ("estimate", "filtered"):
            raise ValueError(f"mean acceleration: {rule} is not allowed; estimate or filtered")
        self.floor = float(floor)
        self.bias_densities = tuple(float(q) for q in bias_densities)
        self.rule = rule
        self.mean = None if mean is None else np.asarray(mean, dtype=float)
        biases = ("bias",) if len(self.bias_densities) == 1 else tuple(f"bias_{i}" for i in range(self.biases))
        self.names = ("x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az", *biases)
        self.units = ("m",) * 3 + ("m/s",) * 3 + ("m/s^2",) * 3 + ("m/s",) * self.biases
        self.input_size = 3
        self._bias_noise = np.diag([0.0] * 9 + list(self.bias_densities))

    @property
    def biases(self) -> int:
        """Number of bias states."""
        return len(self.bias_densities)

    # ---- the input

    def initial_input(self, state: Array) -> Array:
        """Return the mean acceleration to begin with, shape (..., 3)."""
        return state[..., 6:9].copy()

    def next_input(self, state: Array, previous: Array, dt: float) -> Array:
        """Return the mean acceleration of the step that begins at `state`, shape (..., 3)."""
        if self.rule == "estimate":
            return state[..., 6:9].copy()
        keep = math.exp(-self.alpha * dt)
        return keep * state[..., 6:9] + (1 - keep) * previous

    def driven(self, value: Array) -> CurrentStatistical:
        """Return the model with this mean acceleration, shape (..., 3)."""
        found = copy(self)
        found.mean = np.asarray(value, dtype=float)
        return found

    @property
    def held(self) -> Array | None:
        """See `MotionModel.held`."""
        return self.mean

    # ---- the model

    def equations(self, dt: float) -> Step | None:
        """See `MotionModel.equations`; None where the mean acceleration is read off the state."""
        if self.mean is None:
            return None
        limits = (*self.largest.tolist(), *self.smallest.tolist(), self.floor)
        return _step(self.alpha, float(dt), limits, self.bias_densities)

    def _mean(self, state: Array) -> Array:
        return state[..., 6:9] if self.mean is None else self.mean

    def variance(self, mean: Array) -> Array:
        """Return sigma squared of the acceleration for a mean acceleration, both (..., 3) [m/s^2 and its square]."""
        margin = np.where(mean >= 0, self.largest, self.smallest) - mean
        return np.maximum((4 - math.pi) / math.pi * margin**2, self.floor**2)

    def propagate(self, state: Array, dt: float) -> Array:
        """See `MotionModel.propagate`."""
        moved = np.einsum("ij,...j->...i", self.transition(state, dt), state)
        if self.mean is None:
            return moved
        return moved + np.einsum("ij,...j->...i", _matrices(self.alpha, float(dt), self.biases)[1], self.mean)

    def transition(self, state: Array, dt: float) -> Array:
        """See `MotionModel.transition`; shape (n, n)."""
        held, _, _, free = _matrices(self.alpha, float(dt), self.biases)
        return free if self.mean is None else held

    def process_noise(self, state: Array, dt: float) -> Array:
        """See `MotionModel.process_noise`; shape (..., n, n)."""
        _, _, unit, _ = _matrices(self.alpha, float(dt), self.biases)
        variance = self.variance(self._mean(state))
        n = unit.shape[-1]
        spread = np.einsum("...a,ai->...i", variance, unit.reshape(3, n * n)).reshape(*variance.shape[:-1], n, n)
        return spread + dt * self._bias_noise
