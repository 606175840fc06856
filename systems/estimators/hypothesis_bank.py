"""A Gaussian filter for every set of phase integers that still explains the data."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from systems.estimators.base import Epoch, Estimator, Innovation, Memory, Wiring
from systems.estimators.hypotheses_start import HypothesesStart
from systems.estimators.phase_resolver import resolve
from systems.estimators.start import Start
from systems.filters.gaussian import GaussianFilter, take
from systems.filters.hypotheses import log_evidence, merge, mixture, reweigh
from systems.filters.square_root import Posterior
from systems.filters.whitening import Whitener, missing_rows
from systems.measurement.base import MeasurementModel
from systems.measurement.phase import InterferometerPhase, wrap
from systems.measurement.stack import Stack
from systems.motion.base import MotionModel

__all__ = ["HypothesisBank", "phases_of"]

Array = NDArray[np.float64]


def phases_of(model: MeasurementModel) -> list[InterferometerPhase]:
    """Return the interferometer phases in a model or a stack of models."""
    parts = model.models if isinstance(model, Stack) else [model]
    return [part for part in parts if isinstance(part, InterferometerPhase)]


class HypothesisBank(Estimator):
    """Any `GaussianFilter`, once per hypothesis about the integers of wrapped phases.

    Each hypothesis resolves the phases next to its own prediction, so the block may stand before or behind a
    `PhaseResolver`: only the phases wrapped into [-pi, pi) matter. Its weight is multiplied by the likelihood of
    every epoch (`log_evidence`); one that falls below `least_weight` is dropped, and of two that have come to
    the same integers the lighter goes into the other. ``estimate``, ``covariance`` and ``prediction`` are the mean and
    covariance of the mixture: while several hypotheses are alive, the covariance says how far apart they
    are. ``innovation``, ``nis`` and ``nis_dof`` are those of the likeliest.

    Further outputs: ``weights`` (trials, K), falling, and ``integers`` (trials, phases), the whole cycles that the
    likeliest hypothesis added to the wrapped phases of its last epoch that had them.

    Parameters
    ----------
    name : str
        Name of the block.
    algorithm : GaussianFilter
        The filter.
    model, motion, wiring
        See `Estimator`.
    start : Start
        A `HypothesesStart` gives K hypotheses; any other start gives one.
    least_weight : float
        0 < least_weight < 1/K.

    Notes
    -----
    A trial with one hypothesis left is an ordinary filter at an ordinary filter's cost: filters run for living
    hypotheses only.
    """

    def __init__(
        self,
        name: str,
        algorithm: GaussianFilter,
        model: MeasurementModel,
        motion: MotionModel,
        start: Start,
        wiring: Wiring,
        least_weight: float = 1e-5,
    ) -> None:
        self.algorithm = algorithm
        self.hypotheses = start.count if isinstance(start, HypothesesStart) else 1
        if not 0 < least_weight < 1 / self.hypotheses:
            raise ValueError(
                f"{name}: least_weight: {least_weight} is not allowed; > 0 and < 1/hypotheses = {1 / self.hypotheses:g}"
            )
        self.least_weight = least_weight
        phases = phases_of(model)
        self._phases = Stack(phases) if phases else None
        self._phase_rows = [model.names.index(row) for part in phases for row in part.names]
        self._whitener = Whitener(model.noise_covariance())
        super().__init__(name, model, motion, start, wiring)
        after = {self.cached_ticket(self._posterior)}
        trials = wiring.trials
        self.declare_output(
            "weights", trials, self.hypotheses, lambda c: self.cached(c, self._posterior)[0]["weights"], after
        )
        if self._phases is not None:
            size = self._phases.size
            self.declare_output(
                "integers", trials, size, lambda c: self.cached(c, self._posterior)[0]["integers"][:, :size], after
            )

    # ---- memory

    def memory_sizes(self) -> Mapping[str, int]:
        """See `Estimator.memory_sizes`; hypotheses are sorted by falling weight."""
        k, n = self.hypotheses, self.motion.size
        sizes = {"means": k * n, "covariances": k * n * n, "weights": k}
        return {**sizes, "integers": k * len(self._phase_rows)} if self._phase_rows else sizes

    def _pack(self, means: Array, covariances: Array, weights: Array, integers: Array) -> Memory:
        order = np.argsort(-weights, axis=-1, kind="stable")
        if (np.diff(order, axis=-1) < 0).any():
            means = np.take_along_axis(means, order[..., None], axis=1)
            covariances = np.take_along_axis(covariances, order[..., None, None], axis=1)
            integers = np.take_along_axis(integers, order[..., None], axis=1)
            weights = np.take_along_axis(weights, order, axis=1)
        trials = weights.shape[0]
        memory = {
            "means": means.reshape(trials, -1),
            "covariances": covariances.reshape(trials, -1),
            "weights": weights,
        }
        return {**memory, "integers": integers.reshape(trials, -1)} if self._phase_rows else memory

    def _unpack(self, memory: Memory) -> tuple[Array, Array, Array, Array]:
        k, n, p = self.hypotheses, self.motion.size, len(self._phase_rows)
        weights = memory["weights"]
        means = memory["means"].reshape(-1, k, n)
        covariances = memory["covariances"].reshape(-1, k, n, n)
        integers = memory["integers"].reshape(-1, k, p) if p else np.empty((*weights.shape, 0))
        return means, covariances, weights, integers

    # ---- Estimator

    def first(
        self, measurement: Array, platforms: Array, inputs: Mapping[str, Array], epoch: Epoch
    ) -> tuple[Memory, NDArray[np.bool_]]:
        """See `Estimator.first`."""
        if not isinstance(self.start, HypothesesStart):
            return super().first(measurement, platforms, inputs, epoch)
        found = self.start.hypotheses(measurement, platforms, inputs)
        weights = reweigh(found.weight, np.zeros_like(found.weight), self.least_weight)
        return self._pack(*self.start.states(found), weights, found.integers), weights.any(axis=-1)

    def begin(self, mean: Array, covariance: Array, epoch: Epoch) -> Memory:
        """See `Estimator.begin`: one hypothesis."""
        trials, n = mean.shape
        k = self.hypotheses
        means, covariances = np.full((trials, k, n), np.nan), np.full((trials, k, n, n), np.nan)
        means[:, 0], covariances[:, 0] = mean, covariance
        weights = np.zeros((trials, k))
        weights[:, 0] = np.isfinite(mean).all(axis=-1)
        return self._pack(means, covariances, weights, np.full((trials, k, len(self._phase_rows)), np.nan))

    def moments(self, memory: Memory) -> tuple[Array, Array]:
        """See `Estimator.moments`: of the mixture."""
        means, covariances, weights, _ = self._unpack(memory)
        width = max(1, np.count_nonzero((weights > 0).any(axis=0)))
        if width == 1:
            alive = weights[:, 0] > 0
            return (
                np.where(alive[:, None], means[:, 0], np.nan),
                np.where(alive[:, None, None], covariances[:, 0], np.nan),
            )
        return mixture(means[:, :width], covariances[:, :width], weights[:, :width])

    def move(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """See `Estimator.move`."""
        means, covariances, weights, _ = self._unpack(memory)
        alive = np.nonzero(weights > 0)
        moved_means, moved_covariances = means.copy(), covariances.copy()
        moved_means[alive], moved_covariances[alive] = self.algorithm.predict(
            means[alive], covariances[alive], self.motion, dt
        )
        trials = weights.shape[0]
        return {
            **memory,
            "means": moved_means.reshape(trials, -1),
            "covariances": moved_covariances.reshape(trials, -1),
        }

    def correct(
        self,
        memory: Memory,
        measurement: Array,
        platforms: Array,
        noise_covariance: Array | None,
        epoch: Epoch,
    ) -> tuple[Memory, Innovation]:
        """See `Estimator.correct`."""
        means, covariances, weights, integers = self._unpack(memory)
        alive = np.nonzero(weights > 0)
        of_trial = alive[0]
        prior = means[alive], covariances[alive]
        carriers = take(platforms, of_trial)
        value = measurement[of_trial]
        if self._phases is not None:
            predicted = self._phases.predict(prior[0], carriers)
            value[:, self._phase_rows], cycles = resolve(wrap(value[:, self._phase_rows]), predicted)
            integers = integers.copy()
            integers[alive] = np.where(np.isfinite(cycles), cycles, integers[alive])
        noise = None if noise_covariance is None else noise_covariance[of_trial]
        whitener = self._whitener if noise is None else Whitener(noise)
        result = self.algorithm.update(*prior, value, carriers, self.model, whitener)

        likelihood = np.full(weights.shape, -np.inf)
        finite = np.isfinite(result.mean).all(axis=-1)
        likelihood[alive] = np.where(finite, 0.0, -np.inf)
        rivals = np.flatnonzero(finite & (np.count_nonzero(weights > 0, axis=-1) > 1)[of_trial])
        if rivals.size:
            likelihood[alive[0][rivals], alive[1][rivals]] = self._likelihood(
                prior, result, value, carriers, noise, rivals
            )
        weights = reweigh(weights, likelihood, self.least_weight)
        if self._phases is not None and rivals.size:
            weights = merge(weights, integers)

        new_means, new_covariances = np.full_like(means, np.nan), np.full_like(covariances, np.nan)
        new_means[alive], new_covariances[alive] = result.mean, result.covariance
        return self._pack(new_means, new_covariances, weights, integers), self._report(weights, alive, result)

    def _likelihood(
        self,
        prior: tuple[Array, Array],
        result: Posterior,
        value: Array,
        carriers: Array,
        noise: Array | None,
        rows: Array,
    ) -> Array:
        """Return the log-likelihood of the measurement for the hypotheses numbered `rows`."""
        predicted = self.model.predict(result.mean[rows], take(carriers, rows))
        residual = self.model.residual(value[rows], predicted)
        missing = missing_rows(residual)
        whitener = self._whitener if noise is None else Whitener(noise[rows])
        whitened = np.einsum(
            "...ij,...j->...i",
            whitener.matrix(missing),
            residual if missing is None else np.where(missing, 0.0, residual),
        )
        return log_evidence(
            (prior[0][rows], prior[1][rows]), (result.mean[rows], result.covariance[rows]), whitened
        )

    def _report(self, weights: Array, alive: tuple[Array, ...], result: Posterior) -> Innovation:
        """Return what the likeliest hypothesis of each trial reports."""
        trials = weights.shape[0]
        value, nis, dof = np.full((trials, self.model.size), np.nan), np.full(trials, np.nan), np.zeros(trials)
        leads = (np.argmax(weights, axis=-1)[alive[0]] == alive[1]) & (weights[alive] > 0)
        at = alive[0][leads]
        value[at], nis[at], dof[at] = result.innovation[leads], result.nis[leads], result.nis_dof[leads]
        return Innovation(value, nis, dof)
