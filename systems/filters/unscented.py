"""The unscented Kalman filter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.documented import count, number
from quietfix.systems.filters.gaussian import GaussianFilter, Regression, predict_extended
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.square_root import Gains, Posterior, report
from quietfix.systems.filters.whitening import missing_rows
from quietfix.systems.kernels.equations import are_own, program
from quietfix.systems.kernels.unscented.calls import UNSCENTED, predicted, updated
from quietfix.systems.kernels.updating import Update, settings
from quietfix.systems.linear_algebra import cholesky, inverse_lower, symmetric
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel

__all__ = ["UnscentedKalman"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class UnscentedKalman(GaussianFilter):
    r"""Sigma points :math:`\bar x,\ \bar x \pm c L e_i` with :math:`c^2 = \alpha^2 (n + \kappa)`.

    Julier and Uhlmann, *Unscented filtering and nonlinear estimation*, Proc. IEEE 92 (2004) 401-422; scaled form of
    Wan and van der Merwe (2000). The defaults are the cubature rule: 2 n equal points, centre without weight.
    The points are drawn anew from the predicted covariance for the update.

    Parameters
    ----------
    alpha, beta, kappa : float
        Spread (> 0), weight of the centre in the covariance, secondary scaling (n + kappa > 0).
    iterations : int
        How often a measurement is linearised: over the prediction, then over what the linearisation before has left
        (iterated posterior linearisation: Garcia-Fernandez, Svensson, Morelande and Sarkka, *Posterior linearization
        filter: principles and implementation using sigma points*, IEEE Trans. Signal Processing 63 (2015) 5561-5573).
        Over a wide prediction the regression takes the bend of the measurement for noise that is independent of the
        state, which it is not, and the posterior claims too much; a second one is made where the target is.

    Notes
    -----
    The update is written so that it cannot lose definiteness. With :math:`\Delta_i^\pm = h(\bar x \pm c L e_i) -
    h(\bar x)`, odd part :math:`Y e_i = (\Delta_i^+ - \Delta_i^-)/2c` and even part
    :math:`g_i = (\Delta_i^+ + \Delta_i^-)/2`, one has :math:`P_{xz} = L Y^T` and :math:`P_{zz} = Y Y^T + \Omega`,
    :math:`\Omega = \sum_i (g_i - \bar g)(g_i - \bar g)^T/c^2 + w_0\,\bar g\bar g^T`: statistical linearisation
    with the noise :math:`R + \Omega`, which `Gains` takes as it is.
    """

    alpha: float = number("spread of the sigma points", 1.0, above=0)
    beta: float = number("extra weight of the centre in covariances (2: Gaussian)", 0.0)
    kappa: float = number("secondary scaling; n + kappa > 0", 0.0)
    iterations: int = count("linearisations of a measurement, each over what the one before it leaves", 1, at_most=100)

    def __post_init__(self) -> None:
        """Check the arguments."""
        if not (math.isfinite(self.alpha) and self.alpha > 0):
            raise ValueError(f"alpha: {self.alpha} is not allowed; a finite number > 0")
        for name in ("beta", "kappa"):
            if not math.isfinite(getattr(self, name)):
                raise ValueError(f"{name}: {getattr(self, name)} is not allowed; a finite number")
        if not (isinstance(self.iterations, int) and self.iterations >= 1):
            raise ValueError(f"iterations: {self.iterations} is not allowed; a whole number >= 1")

    def _weights(self, n: int) -> tuple[float, float, float]:
        """Return c, the weight of an outer point, and the centre's weight in a covariance."""
        if n + self.kappa <= 0:
            raise ValueError(f"kappa: {self.kappa} is not allowed; it must be > -{n}, the number of states")
        c2 = self.alpha**2 * (n + self.kappa)
        return math.sqrt(c2), 0.5 / c2, 2.0 - n / c2 - self.alpha**2 + self.beta

    def predict(self, mean: Array, covariance: Array, motion: MotionModel, dt: float) -> tuple[Array, Array]:
        """See `GaussianFilter.predict`; in closed form where the motion is linear."""
        if motion.linear:
            return predict_extended(mean, covariance, motion, dt)
        weights = c, weight, centre = self._weights(mean.shape[-1])
        step = motion.equations(dt) if are_own(type(motion)) else None
        if step is not None:
            return predicted(mean, covariance, step, motion.held, weights)
        spread = c * np.swapaxes(cholesky(covariance), -1, -2)
        wide = mean[..., None, :]
        middle = motion.propagate(mean, dt)[..., None, :]
        plus = motion.propagate(wide + spread, dt) - middle
        minus = motion.propagate(wide - spread, dt) - middle
        shift = weight * (plus + minus).sum(axis=-2, keepdims=True)
        moved = np.concatenate([plus - shift, minus - shift], axis=-2)
        after = weight * (np.swapaxes(moved, -1, -2) @ moved)
        after += centre * np.swapaxes(shift, -1, -2) * shift
        after = symmetric(after) + motion.process_noise(mean, dt)
        return (middle + shift)[..., 0, :], after

    def regress(self, mean: Array, covariance: Array, motion: MotionModel, dt: float) -> Regression:
        r"""See `GaussianFilter.regress`: statistical linearisation, :math:`A = Y L^{-1}, \Lambda = \Omega + Q`."""
        if motion.linear:
            return super().regress(mean, covariance, motion, dt)
        c, weight, centre = self._weights(mean.shape[-1])
        root = cholesky(covariance)
        spread, wide = c * np.swapaxes(root, -1, -2), mean[..., None, :]
        middle = motion.propagate(mean, dt)[..., None, :]
        plus, minus = motion.propagate(wide + spread, dt) - middle, motion.propagate(wide - spread, dt) - middle
        even = 0.5 * (plus + minus)
        shift = 2 * weight * even.sum(axis=-2, keepdims=True)
        bends = even - shift
        omega = 2 * weight * (np.swapaxes(bends, -1, -2) @ bends) + centre * np.swapaxes(shift, -1, -2) * shift
        transition = np.swapaxes((plus - minus) / (2 * c), -1, -2) @ inverse_lower(root)
        return Regression((middle + shift)[..., 0, :], transition, omega + motion.process_noise(mean, dt))

    def whole_update(self, states: int) -> tuple[Update, Array] | None:
        """See `GaussianFilter.whole_update`."""
        kind = type(self)
        own = kind.update is UnscentedKalman.update and kind.predict is UnscentedKalman.predict
        if not own or self.iterations > 1:
            return None
        return UNSCENTED, settings(*self._weights(states))

    def update(self, mean: Array, covariance: Array, observation: Observation, model: MeasurementModel) -> Posterior:
        """See `GaussianFilter.update`."""
        weights = self._weights(mean.shape[-1])
        compiled = program(model)
        if compiled is not None and self.iterations == 1:
            value, platforms, noise = observation.value, observation.platforms, observation.noise_covariance
            return Posterior(*updated(mean, covariance, value, platforms, noise, compiled, weights))
        prior = cholesky(covariance)
        first = seen = self._seen(mean, prior, weights, observation, model)
        gains = Gains(prior, seen.inflated @ np.swapaxes(seen.odd, -1, -2))
        step, nis = gains.update((seen.inflated @ seen.innovation[..., None])[..., 0])
        for _ in range(self.iterations - 1):
            at, after = mean + step, gains.covariance()
            root = cholesky(after)
            seen = self._seen(at, root, weights, observation, model)
            slope = np.swapaxes(seen.odd, -1, -2) @ inverse_lower(root)
            left = seen.innovation + (slope @ step[..., None])[..., 0]
            gains = Gains(prior, seen.inflated @ (slope @ prior))
            step, nis = gains.update((seen.inflated @ left[..., None])[..., 0])
        return report(mean + step, gains.covariance(), first.innovation, nis, first.missing)

    def _seen(
        self,
        mean: Array,
        root: Array,
        weights: tuple[float, float, float],
        observation: Observation,
        model: MeasurementModel,
    ) -> _Seen:
        """Return the measurement linearised statistically over a belief with the covariance L L'."""
        n, (c, weight, centre) = mean.shape[-1], weights
        values = model.predict(_points(mean, c * root), observation.platforms[:, None])
        middle = values[..., :1, :]
        moved = model.residual(values[..., 1:, :], middle)
        plus, minus = moved[..., :n, :], moved[..., n:, :]
        even = 0.5 * (plus + minus)
        shift = 2 * weight * even.sum(axis=-2)
        innovation = model.residual(observation.value, middle[..., 0, :]) - shift

        missing = missing_rows(innovation)  # what is missing in one of the points is so in their mean
        odd = (plus - minus) / (2 * c)
        if missing is not None:
            innovation = np.where(missing, 0.0, innovation)
            odd, even = (np.where(missing[..., None, :], 0.0, part) for part in (odd, even))
            shift = np.where(missing, 0.0, shift)
        w = observation.whitener.matrix(missing)
        bends = (even - shift[..., None, :]) @ np.swapaxes(w, -1, -2)
        bend = (w @ shift[..., None])[..., 0]
        omega = 2 * weight * (np.swapaxes(bends, -1, -2) @ bends)
        omega += centre * bend[..., :, None] * bend[..., None, :]
        return _Seen(innovation, odd, inverse_lower(cholesky(np.eye(model.size) + omega)) @ w, missing)


class _Seen(NamedTuple):
    """A measurement over a belief: innovation (trials, m), Y' (trials, n, m), and what whitens by R + Omega."""

    innovation: Array
    odd: Array
    inflated: Array
    missing: NDArray[np.bool_] | None


def _points(mean: Array, spread: Array) -> Array:
    """Return mean, mean + and mean - each column of `spread` (trials, n, n), shape (trials, 2 n + 1, n).

    In memory each component of the state lies in one piece, for all trials and points: measurement models work on
    components.
    """
    trials, n = mean.shape
    parts = np.empty((n, trials, 2 * n + 1))
    columns, middle = np.swapaxes(spread, 0, 1), mean.T[..., None]
    parts[..., :1] = middle
    np.add(middle, columns, out=parts[..., 1 : n + 1])
    np.subtract(middle, columns, out=parts[..., n + 1 :])
    return parts.transpose(1, 2, 0)
