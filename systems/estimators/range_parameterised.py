"""A bank of Gaussian filters, one for each interval of range."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.memory import Epoch, Innovation, Memory
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.filters.observation import Observation
from quietfix.systems.linear_algebra import quadratic
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.bearing_start import BearingStart
from quietfix.systems.starts.start import Start

__all__ = ["RangeParameterised", "intervals"]

Array = NDArray[np.float64]

_WEIGHTLESS = -60.0  # logarithm of a weight that no longer moves a mean


def intervals(nearest: float, farthest: float, count: int) -> tuple[Array, Array]:
    r"""Return the middles and standard deviations of intervals of range in geometric progression.

    With :math:`\rho = (r_{max}/r_{min})^{1/N}` the i-th interval is :math:`r_{min}[\rho^{i}, \rho^{i+1}]`; its range is
    taken as uniform, so that every hypothesis has the same coefficient of variation.

    Returns
    -------
    middle, sigma : ndarray, shape (count,)
        [m]
    """
    edges = nearest * (farthest / nearest) ** (np.arange(count + 1) / count)
    return 0.5 * (edges[1:] + edges[:-1]), (edges[1:] - edges[:-1]) / np.sqrt(12)


class RangeParameterised(Estimator):
    r"""The same filter from several ranges side by side, weighted by how well each predicts the bearings.

    .. math:: w_i \leftarrow w_i\,N(\nu_i;\ 0,\ H_i P_i H_i^T + R), \qquad
              \hat x = \sum_i w_i \hat x_i, \qquad
              P = \sum_i w_i [P_i + (\hat x_i - \hat x)(\hat x_i - \hat x)^T]

    Peach, *Bearings-only tracking using a set of range-parameterised extended Kalman filters*, IEE Proc. Control Theory
    and Applications 142 (1995) 73-80. One filter started with a wide range is linearised far from where the target
    is; a narrow hypothesis is not.

    Parameters
    ----------
    name : str
        Name of the block.
    algorithm : GaussianFilter
        The filter of each hypothesis.
    model, motion, start, wiring
        See `Estimator`.
    nearest, farthest : float
        The target's range at the start lies between them [m].
    hypotheses : int
        Number of intervals.

    Raises
    ------
    ValueError
        If the start is not one from a bearing, or the ranges are not in order.
    """

    def __init__(
        self,
        name: str,
        algorithm: GaussianFilter,
        model: MeasurementModel,
        motion: MotionModel,
        start: BearingStart,
        wiring: Wiring,
        nearest: float,
        farthest: float,
        hypotheses: int,
    ) -> None:
        if not isinstance(start, BearingStart):
            raise ValueError(
                f"{name}: hypotheses of range need a start from the first bearing in a plane, as in bearing_crossing"
            )
        if not 0 < nearest < farthest:
            raise ValueError(f"{name}: ranges {nearest:g} to {farthest:g} m are not allowed; 0 < nearest < farthest")
        self.algorithm = algorithm
        self.hypotheses = hypotheses
        self._ranges = intervals(nearest, farthest, hypotheses)
        middles, sigmas = self._ranges
        # Of the mixture that the hypotheses are at the start.
        self.sigma_distance = float(np.sqrt(np.mean(sigmas**2 + middles**2) - middles.mean() ** 2))
        self._from = start
        super().__init__(name, model, motion, _EveryRange(start, *self._ranges), wiring)

    def bound_prior(self, truth: Array, platforms: Array) -> tuple[Array, bool]:
        """See `Estimator.bound_prior`: the mixture's range."""
        return self._from.covariance_at(truth, platforms, self.sigma_distance), True

    def memory_sizes(self) -> Mapping[str, int]:
        """See `Estimator.memory_sizes`."""
        n, count = self.motion.size, self.hypotheses
        return {"means": count * n, "covariances": count * n * n, "log_weights": count}

    def begin(self, mean: Array, covariance: Array, epoch: Epoch) -> Memory:
        """See `Estimator.begin`; mean and covariance are those of all hypotheses."""
        weights = np.full((mean.shape[0], self.hypotheses), -np.log(self.hypotheses))
        return {
            "means": np.array(mean),
            "covariances": covariance.reshape(mean.shape[0], -1).copy(),
            "log_weights": weights,
        }

    def _bank(self, memory: Memory) -> tuple[Array, Array]:
        n = self.motion.size
        return memory["means"].reshape(-1, n), memory["covariances"].reshape(-1, n, n)

    def predict(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """See `Estimator.predict`."""
        means, covariances = self.algorithm.predict(*self._bank(memory), self.motion, dt)
        trials = memory["log_weights"].shape[0]
        return {
            "means": means.reshape(trials, -1),
            "covariances": covariances.reshape(trials, -1),
            "log_weights": memory["log_weights"],
        }

    def update(self, memory: Memory, observation: Observation, epoch: Epoch) -> tuple[Memory, Innovation]:
        """See `Estimator.update`; a trial without a finite belief stays without."""
        count, (trials, m) = self.hypotheses, observation.value.shape
        mean, covariance = self._bank(memory)
        n = mean.shape[-1]
        lost = ~np.all(np.isfinite(memory["means"]), axis=-1)
        alone = np.repeat(lost, count)
        mean = np.where(alone[:, None], 1.0, mean)
        covariance = np.where(alone[:, None, None], np.eye(n), covariance)
        each = observation.without(lost[:, None]).rows(np.repeat(np.arange(trials), count))
        value, jacobian = self.model.linearize(mean, each.platforms)
        spread = jacobian @ covariance @ np.swapaxes(jacobian, -1, -2) + each.noise_covariance
        residual = self.model.residual(each.value, value)
        likelihood = _log_density(residual, spread)
        result = self.algorithm.update(mean, covariance, each, self.model)

        prior = np.where(lost[:, None], 0.0, memory["log_weights"])
        weights = prior + likelihood.reshape(trials, count)
        weights -= weights.max(axis=-1, keepdims=True)
        weights -= np.log(np.exp(weights).sum(axis=-1, keepdims=True))
        posterior = {
            "means": result.mean.reshape(trials, -1),
            "covariances": result.covariance.reshape(trials, -1),
            "log_weights": np.maximum(weights, _WEIGHTLESS),
        }
        if lost.any():
            posterior = {group: np.where(lost[:, None], np.nan, value) for group, value in posterior.items()}
        innovation = self._innovation(prior, residual.reshape(trials, count, m), spread.reshape(trials, count, m, m))
        return posterior, innovation

    @staticmethod
    def _innovation(log_weights: Array, residual: Array, spread: Array) -> Innovation:
        """Return mean, NIS and rows of the mixture that was predicted."""
        w = np.exp(log_weights - log_weights.max(axis=-1, keepdims=True))
        w /= w.sum(axis=-1, keepdims=True)
        mean = np.einsum("...i,...ij->...j", w, residual)
        off = residual - mean[:, None, :]
        covariance = np.einsum("...i,...ijk->...jk", w, spread + off[..., :, None] * off[..., None, :])
        value, dof, _ = quadratic(mean, covariance)
        return Innovation(mean, np.where(dof > 0, value, np.nan), dof)

    def moments(self, memory: Memory) -> tuple[Array, Array]:
        """See `Estimator.moments`."""
        n, count = self.motion.size, self.hypotheses
        w = np.exp(memory["log_weights"])
        w = w / w.sum(axis=-1, keepdims=True)
        means = memory["means"].reshape(-1, count, n)
        mean = np.einsum("ti,tij->tj", w, means)
        off = means - mean[:, None, :]
        parts = memory["covariances"].reshape(-1, count, n, n) + off[..., :, None] * off[..., None, :]
        return mean, np.einsum("ti,tijk->tjk", w, parts)


class _EveryRange(Start):
    """The beliefs of all hypotheses one behind the other."""

    uses_measurement = True

    def __init__(self, single: BearingStart, middles: Array, sigmas: Array) -> None:
        self._single = single
        self._pairs = list(zip(middles.tolist(), sigmas.tolist(), strict=True))

    def begin(self, measurement: Array, platforms: Array, inputs: Mapping[str, Array]) -> tuple[Array, Array]:
        """See `Start.begin`; shapes (trials, hypotheses * n) and (trials, hypotheses * n * n)."""
        angles = measurement[:, self._single.rows]
        beliefs = [self._single.belief(angles, platforms, *pair) for pair in self._pairs]
        trials = measurement.shape[0]
        mean = np.concatenate([mean for mean, _ in beliefs], axis=-1)
        return mean, np.concatenate([covariance.reshape(trials, -1) for _, covariance in beliefs], axis=-1)


def _log_density(residual: Array, covariance: Array) -> Array:
    """Return the logarithm of the Gaussian density, up to a constant, over the rows that are there."""
    value, _, kept = quadratic(residual, covariance)
    return -0.5 * (value + np.linalg.slogdet(kept)[1])
