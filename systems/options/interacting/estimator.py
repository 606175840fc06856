"""Gaussian filters of several motions that interact, behind the common ports."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.memory import Epoch, Innovation, Memory
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.filters.hypotheses import mixture, normalised
from quietfix.systems.filters.interacting import (
    finite_models,
    innovation_likelihood,
    mixed,
    updated_probabilities,
)
from quietfix.systems.filters.mode_chain import ModeChain
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.square_root import Posterior
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["InteractingModels"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class InteractingModels(Estimator):
    r"""One Gaussian filter per motion; before each step they are mixed, after each measurement weighed.

    See `quietfix.systems.filters.interacting`. ``estimate``, ``covariance`` and ``prediction`` are the moments of the
    mixture; ``innovation``, ``nis`` and ``nis_dof`` are the filter's for the moments of the predicted mixture. A model
    whose filter is lost has no probability until the others become it.

    Further output: ``probabilities`` (trials, M).

    .. math:: \mu_{i|j} = \pi_{ij}\,\mu_i / c_j, \qquad x_{0j} = \sum_i \mu_{i|j}\,x_i, \qquad
              \mu_j \propto \Lambda_j \sum_i \pi_{ij}\,\mu_i

    Parameters
    ----------
    name : str
        Name of the block.
    algorithm : GaussianFilter
        The filter.
    model, motion, start, wiring
        See `Estimator`; `motion` is what the bounds are made for.
    motions : mapping of str to MotionModel
        The motions by name; all with the states of `motion`, none with an input.
    chain : ModeChain
        How one is followed by another, in the same order.
    initial : ndarray, shape (M,)
        Their probabilities at the start.

    Raises
    ------
    ValueError
        If the motions do not have the same states, or the chain not as many modes.
    """

    def __init__(
        self,
        name: str,
        algorithm: GaussianFilter,
        model: MeasurementModel,
        motion: MotionModel,
        start: Start,
        wiring: Wiring,
        motions: Mapping[str, MotionModel],
        chain: ModeChain,
        initial: Array,
    ) -> None:
        for own, one in motions.items():
            if one.names != motion.names or one.input_size:
                what = "an input is" if one.input_size else f"the states {', '.join(one.names)} are"
                raise ValueError(f"{name}: models.{own}: {what} not allowed; the states {', '.join(motion.names)}")
        if chain.size != len(motions):
            raise ValueError(f"{name}: transitions between {chain.size} models; there are {len(motions)}")
        self.algorithm, self.motions, self.chain = algorithm, dict(motions), chain
        self._initial = np.array(initial, dtype=float)
        super().__init__(name, model, motion, start, wiring)
        named = [(own, "1") for own in self.motions]
        self.tell("probabilities", len(self.motions), lambda memory: memory["probabilities"], named)

    def diagnostics(self) -> Sequence[str]:
        """See `Estimator.diagnostics`."""
        return ("probabilities",)

    # ---- memory

    def memory_sizes(self) -> Mapping[str, int]:
        """See `Estimator.memory_sizes`."""
        k, n = len(self.motions), self.motion.size
        return {"means": k * n, "covariances": k * n * n, "probabilities": k}

    def _tables(self, memory: Memory) -> tuple[Array, Array, Array]:
        """Return means (trials, M, n), covariances and probabilities (trials, M)."""
        k, n = len(self.motions), self.motion.size
        return memory["means"].reshape(-1, k, n), memory["covariances"].reshape(-1, k, n, n), memory["probabilities"]

    @staticmethod
    def _memory(means: Array, covariances: Array, probabilities: Array) -> Memory:
        trials = means.shape[0]
        return {
            "means": means.reshape(trials, -1),
            "covariances": covariances.reshape(trials, -1),
            "probabilities": probabilities,
        }

    def begin(self, mean: Array, covariance: Array, epoch: Epoch) -> Memory:
        """See `Estimator.begin`: all models begin alike."""
        k, n = len(self.motions), self.motion.size
        means = np.repeat(np.array(mean)[:, None], k, axis=1)
        covariances = np.repeat(np.reshape(covariance, (-1, 1, n, n)), k, axis=1)
        return self._memory(means, covariances, np.tile(self._initial, (mean.shape[0], 1)))

    def moments(self, memory: Memory) -> tuple[Array, Array]:
        """See `Estimator.moments`: of the mixture."""
        means, covariances, probabilities = self._tables(memory)
        if len(self.motions) == 1:
            return means[:, 0], covariances[:, 0]
        return mixture(means, covariances, probabilities)

    # ---- a step

    def predict(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """See `Estimator.predict`: the filters are mixed, and each predicts by its own motion."""
        means, covariances, probabilities = mixed(*self._tables(memory), self.chain.over(float(dt)))
        for j, motion in enumerate(self.motions.values()):
            mean = np.ascontiguousarray(means[:, j])
            covariance = np.ascontiguousarray(covariances[:, j])
            means[:, j], covariances[:, j] = self.algorithm.predict(mean, covariance, motion, dt)
        return self._memory(means, covariances, probabilities)

    def update(self, memory: Memory, observation: Observation, epoch: Epoch) -> tuple[Memory, Innovation]:
        """See `Estimator.update`."""
        means, covariances, probabilities = self._tables(memory)
        trials, k, n = means.shape
        sound = finite_models(means, covariances)
        flat = sound.ravel()
        mean = means.reshape(-1, n)
        prior = covariances.reshape(-1, n, n)
        told = observation if k == 1 else observation.rows(np.repeat(np.arange(trials), k))
        result = self._update(mean, prior, flat, told)
        finite = flat & finite_models(result.mean[None], result.covariance[None])[0]
        after = result.mean.reshape(means.shape), result.covariance.reshape(covariances.shape)
        if k == 1:
            posterior = self._memory(*after, np.where(finite, 1.0, np.nan)[:, None])
            return posterior, Innovation(result.innovation, result.nis, result.nis_dof)

        likelihood = np.full(flat.shape, -np.inf)
        likelihood[finite] = innovation_likelihood(prior[finite], result.covariance[finite], result.nis[finite])
        before = normalised(np.where(sound, probabilities, 0.0))
        posterior = self._memory(*after, updated_probabilities(before, likelihood.reshape(trials, k)))
        together, spread = mixture(means, covariances, before)
        there = finite_models(together[None], spread[None])[0]
        seen = self._update(together, spread, there, observation)
        return posterior, Innovation(seen.innovation, seen.nis, seen.nis_dof)

    def _update(self, mean: Array, covariance: Array, sound: Mask, observation: Observation) -> Posterior:
        """Return the filter's update; beliefs (k,) that are not sound are set aside and stay as they are not: NaN."""
        if sound.all():
            return self.algorithm.update(mean, covariance, observation, self.model)
        lost = ~sound
        mean = np.where(lost[:, None], 1.0, mean)
        covariance = np.where(lost[:, None, None], np.eye(mean.shape[-1]), covariance)
        result = self.algorithm.update(mean, covariance, observation.without(lost[:, None]), self.model)
        return result._replace(
            mean=np.where(lost[:, None], np.nan, result.mean),
            covariance=np.where(lost[:, None, None], np.nan, result.covariance),
        )
