"""A Gaussian filter for every set of phase integers that still explains the data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.angle_wrapping import wrap
from quietfix.systems.angles.phase import InterferometerPhase
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.memory import Epoch, Innovation, Memory
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.filters.hypotheses import branch, in_doubt, log_evidence, mixture, reweigh
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.whitening import missing_rows
from quietfix.systems.linear_algebra import symmetric
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.hypotheses_start import HypothesesStart
from quietfix.systems.starts.start import Start

__all__ = ["HypothesisBank", "phases_of"]

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]


def phases_of(model: MeasurementModel) -> list[InterferometerPhase]:
    """Return the interferometer phases in a model or a stack of models."""
    parts = model.models if isinstance(model, Stack) else [model]
    return [part for part in parts if isinstance(part, InterferometerPhase)]


class _Living(NamedTuple):
    """The hypotheses that are alive, of all trials in one row after the other.

    Attributes
    ----------
    trial, slot : ndarray, shape (living,)
        Where each belongs; `trial` rises.
    mean, covariance : ndarray, shapes (living, n) and (living, n, n)
    weight : ndarray, shape (living,)
    integers : ndarray, shape (living, phases)
    """

    trial: Index
    slot: Index
    mean: Array
    covariance: Array
    weight: Array
    integers: Array

    def rows(self, rows: Index) -> _Living:
        """Return some of them."""
        trial, slot, mean, covariance, weight, integers = self
        return _Living(trial[rows], slot[rows], mean[rows], covariance[rows], weight[rows], integers[rows])


class HypothesisBank(Estimator):
    r"""Any `GaussianFilter`, once per hypothesis about the integers of wrapped phases.

    Each hypothesis resolves the phases next to its own prediction, so the block may stand before or behind a
    `PhaseResolver`: only the phases wrapped into [-pi, pi) matter. Its weight is multiplied by the likelihood of
    every epoch (`log_evidence`); one that falls below `least_weight` is dropped. Where a gap has left a prediction too
    vague for one integer, a hypothesis branches (`branch`). ``estimate``, ``covariance`` and ``prediction`` are the
    moments of the mixture: while several hypotheses are alive, the covariance says how far apart they are.
    ``innovation``, ``nis`` and ``nis_dof`` are those of the likeliest.

    Further outputs: ``weights`` (trials, K), falling, and ``integers`` (trials, phases), the whole cycles that the
    likeliest hypothesis added to the wrapped phases of its last epoch that had them.

    .. math:: w_i \leftarrow \frac{w_i\,p_i(z)}{\sum_j w_j\,p_j(z)}, \qquad \hat x = \sum_i w_i x_i, \qquad
              P = \sum_i w_i\,[P_i + (x_i - \hat x)(x_i - \hat x)^T]

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
        self.hypotheses = start.count
        if not 0 < least_weight < 1 / self.hypotheses:
            raise ValueError(
                f"{name}: least_weight: {least_weight} is not allowed; > 0 and < 1/hypotheses = {1 / self.hypotheses:g}"
            )
        self.least_weight = least_weight
        phases = phases_of(model)
        self._phases = Stack(phases) if phases else None
        self._phase_rows = [model.names.index(row) for part in phases for row in part.names]
        self._is_phase = np.isin(np.arange(model.size), self._phase_rows)
        super().__init__(name, model, motion, start, wiring)
        self.tell("weights", self.hypotheses, lambda memory: memory["weights"])
        if self._phases is not None:
            size = self._phases.size
            named = [(row, "1") for row in self._phases.names]
            self.tell("integers", size, lambda memory: memory["integers"][:, :size], named)

    # ---- memory

    def diagnostics(self) -> Sequence[str]:
        """See `Estimator.diagnostics`."""
        return [port for port in ("integers", "weights") if port in self.output_names()]

    def memory_sizes(self) -> Mapping[str, int]:
        """See `Estimator.memory_sizes`; hypotheses are sorted by falling weight."""
        k, n = self.hypotheses, self.motion.size
        return {"means": k * n, "covariances": k * n * n, "weights": k, "integers": k * max(1, len(self._phase_rows))}

    def _tables(self, memory: Memory) -> tuple[Array, Array, Array, Array]:
        """Return means (trials, K, n), covariances, weights (trials, K) and integers (trials, K, phases)."""
        k, n = self.hypotheses, self.motion.size
        return (
            memory["means"].reshape(-1, k, n),
            memory["covariances"].reshape(-1, k, n, n),
            memory["weights"],
            memory["integers"].reshape(-1, k, max(1, len(self._phase_rows))),
        )

    def _living(self, memory: Memory) -> _Living:
        means, covariances, weights, integers = self._tables(memory)
        finite = np.isfinite(means.sum(axis=-1) + covariances.sum(axis=(-1, -2)))
        trial, slot = np.nonzero((weights > 0) & finite)
        at = trial, slot
        return _Living(trial, slot, means[at], covariances[at], weights[at], integers[at])

    def _spread(self, living: _Living, rows: Array, trials: int, fill: float = np.nan) -> Array:
        """Return one number or array per living hypothesis as a table (trials, K, ...)."""
        table = np.full((trials, self.hypotheses, *rows.shape[1:]), fill)
        table[living.trial, living.slot] = rows
        return table

    def _memory(self, means: Array, covariances: Array, weights: Array, integers: Array) -> Memory:
        order = np.argsort(-weights, axis=-1, kind="stable")
        tables = {"means": means, "covariances": covariances, "weights": weights, "integers": integers}
        if (np.diff(order, axis=-1) < 0).any():
            rows = np.arange(weights.shape[0])[:, None]
            tables = {group: table[rows, order] for group, table in tables.items()}
        return {group: table.reshape(weights.shape[0], -1) for group, table in tables.items()}

    # ---- Estimator

    def first(
        self, measurement: Array, platforms: Array, inputs: Mapping[str, Array], epoch: Epoch
    ) -> tuple[Memory, Mask]:
        """See `Estimator.first`."""
        if not isinstance(self.start, HypothesesStart):
            return super().first(measurement, platforms, inputs, epoch)
        found = self.start.hypotheses(measurement, platforms, inputs)
        weights = reweigh(found.weight, np.zeros_like(found.weight), self.least_weight)
        return self._memory(*self.start.states(found, platforms), weights, found.integers), np.any(weights > 0, axis=-1)

    def begin(self, mean: Array, covariance: Array, epoch: Epoch) -> Memory:
        """See `Estimator.begin`: one hypothesis."""
        trials = mean.shape[0]
        means, covariances, weights, integers = self._tables(
            {group: np.full((trials, size), np.nan) for group, size in self.memory_sizes().items()}
        )
        means[:, 0], covariances[:, 0] = mean, covariance
        weights[:] = 0.0
        weights[:, 0] = np.isfinite(mean).all(axis=-1)
        return self._memory(means, covariances, weights, integers)

    def moments(self, memory: Memory) -> tuple[Array, Array]:
        """See `Estimator.moments`: of the mixture."""
        means, covariances, weights, _ = self._tables(memory)
        width = max(1, np.count_nonzero((weights > 0).any(axis=0)))
        if width == 1:
            alone = weights[:, 0] > 0
            covariance = np.where(alone[:, None, None], covariances[:, 0], np.nan)
            return np.where(alone[:, None], means[:, 0], np.nan), symmetric(covariance)
        return mixture(means[:, :width], covariances[:, :width], weights[:, :width])

    def predict(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """See `Estimator.predict`."""
        living = self._living(memory)
        mean, covariance = self.algorithm.predict(living.mean, living.covariance, self.motion, dt)
        trials = memory["weights"].shape[0]
        return {
            **memory,
            "means": self._spread(living, mean, trials).reshape(trials, -1),
            "covariances": self._spread(living, covariance, trials).reshape(trials, -1),
        }

    def update(self, memory: Memory, observation: Observation, epoch: Epoch) -> tuple[Memory, Innovation]:
        """See `Estimator.update`."""
        trials = observation.value.shape[0]
        living = self._living(memory)
        living, told = self._resolve(living, observation.rows(living.trial))
        result = self.algorithm.update(living.mean, living.covariance, told, self.model)

        finite = np.isfinite(result.mean).all(axis=-1) & np.isfinite(result.covariance).all(axis=(-1, -2))
        likelihood = np.where(finite, 0.0, -np.inf)
        rivals = np.flatnonzero(finite & (np.bincount(living.trial, minlength=trials)[living.trial] > 1))
        if rivals.size:
            likelihood[rivals] = self._likelihood(
                living.rows(rivals), told.rows(rivals), result.mean[rivals], result.covariance[rivals]
            )
        weights = reweigh(
            self._spread(living, living.weight, trials, 0.0),
            self._spread(living, likelihood, trials, -np.inf),
            self.least_weight,
        )
        means = self._spread(living, result.mean, trials)
        covariances = self._spread(living, result.covariance, trials)
        integers = self._spread(living, living.integers, trials)
        leads = (np.argmax(weights, axis=-1)[living.trial] == living.slot) & (weights[living.trial, living.slot] > 0)
        value, nis, dof = np.full((trials, self.model.size), np.nan), np.full(trials, np.nan), np.zeros(trials)
        at = living.trial[leads]
        value[at], nis[at], dof[at] = result.innovation[leads], result.nis[leads], result.nis_dof[leads]
        return self._memory(means, covariances, weights, integers), Innovation(value, nis, dof)

    # ---- one epoch of the living

    def _resolve(self, living: _Living, told: Observation) -> tuple[_Living, Observation]:
        """Add whole cycles to the phases; a hypothesis that leaves several possible branches."""
        if self._phases is None:
            return living, told
        value = told.value.copy()
        wrapped = wrap(value[:, self._phase_rows])
        turns, sigma = self._turns(living.mean, living.covariance, wrapped, told.platforms)
        vague = np.flatnonzero(in_doubt(turns, sigma))
        if vague.size:
            # After a gap: with what the other rows say of the place, fewer integers are left.
            doubtful, silent = living.rows(vague), told.rows(vague).without(self._is_phase)
            after = self.algorithm.update(doubtful.mean, doubtful.covariance, silent, self.model)
            turns[vague], sigma[vague] = self._turns(after.mean, after.covariance, wrapped[vague], silent.platforms)
        parent, whole, slot = branch(turns, sigma, living.weight, living.trial, living.slot, self.hypotheses)
        value = value[parent]
        value[:, self._phase_rows] = wrapped[parent] + 2 * np.pi * whole
        chosen = living.rows(parent)
        integers = np.where(np.isfinite(whole), whole, chosen.integers)
        return chosen._replace(slot=slot, integers=integers), replace(told.rows(parent), value=value)

    def _turns(self, mean: Array, covariance: Array, wrapped: Array, platforms: Array) -> tuple[Array, Array]:
        """Return predicted minus wrapped phases and the standard deviation of that, both in cycles."""
        assert self._phases is not None
        predicted, rows = self._phases.linearize(mean, platforms)
        variance = np.einsum("...mi,...mi->...m", rows @ covariance, rows) + self._phases.sigmas**2
        return (predicted - wrapped) / (2 * np.pi), np.sqrt(variance) / (2 * np.pi)

    def _likelihood(self, living: _Living, told: Observation, mean: Array, covariance: Array) -> Array:
        """Return the log-likelihood of what each hypothesis is told, given its belief before and after."""
        residual = self.model.residual(told.value, self.model.predict(mean, told.platforms))
        missing = missing_rows(residual)
        present = residual if missing is None else np.where(missing, 0.0, residual)
        whitened = np.einsum("...ij,...j->...i", told.whitener.matrix(missing), present)
        return log_evidence((living.mean, living.covariance), (mean, covariance), whitened)
