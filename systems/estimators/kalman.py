"""Gaussian filters as estimator blocks."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.memory import Epoch, Innovation, Memory
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.considered import ConsideredStates
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.recovery.surprise import RULE
from quietfix.systems.filters.robust import StudentRows
from quietfix.systems.kernels.equations import program
from quietfix.systems.kernels.whole.stepping import Linear, Ports
from quietfix.systems.linear_algebra import all_finite
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["KalmanEstimator"]

Array = NDArray[np.float64]

_STEP = ("predict", "update", "moments", "memory_sizes")


class KalmanEstimator(Estimator):
    r"""Any `GaussianFilter` (extended, iterated, unscented, a user's own) behind the common ports.

    .. math:: x^- = f(x), \quad P^- = \Phi P \Phi^T + Q, \qquad \nu = z - h(x^-), \quad S = H P^- H^T + R, \quad
              \mathrm{NIS} = \nu^T S^{-1} \nu

    and the filter's own update; rows that are NaN are left out of it (Bar-Shalom, Li and Kirubarajan, *Estimation with
    Applications to Tracking and Navigation*, 2001, ch. 5 and 10).

    Parameters
    ----------
    name : str
        Name of the block.
    algorithm : GaussianFilter
        The filter.
    model, motion, start, wiring
        See `Estimator`.
    """

    def __init__(
        self,
        name: str,
        algorithm: GaussianFilter,
        model: MeasurementModel,
        motion: MotionModel,
        start: Start,
        wiring: Wiring,
    ) -> None:
        if wiring.tails is not None:
            tailed = [i for i, row in enumerate(model.names) if row in wiring.tails.rows]
            algorithm = StudentRows(algorithm, wiring.tails.freedom, tailed)
        self.algorithm = ConsideredStates(algorithm, motion.considered) if motion.considered else algorithm
        self.considered = len(motion.considered)
        self._linear: Linear | None = None
        super().__init__(name, model, motion, start, wiring)
        self._size = wiring.trials * motion.size

    def memory_sizes(self) -> Mapping[str, int]:
        """See `Estimator.memory_sizes`."""
        n = self.motion.size
        sizes = {"mean": n, "covariance": n * n}
        return {**sizes, "motion_input": self.motion.input_size} if self.motion.input_size else sizes

    def begin(self, mean: Array, covariance: Array, epoch: Epoch) -> Memory:
        """See `Estimator.begin`."""
        memory = {"mean": np.array(mean), "covariance": np.reshape(covariance, (mean.shape[0], -1)).copy()}
        if self.motion.input_size:
            memory["motion_input"] = self.motion.initial_input(memory["mean"])
        return memory

    def moments(self, memory: Memory) -> tuple[Array, Array]:
        """See `Estimator.moments`."""
        mean = memory["mean"]
        n = mean.shape[-1]
        return mean, memory["covariance"].reshape(-1, n, n)

    def predict(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """See `Estimator.predict`."""
        motion, carried = self.motion, {}
        if motion.input_size:
            carried = {"motion_input": motion.next_input(memory["mean"], memory["motion_input"], dt)}
            motion = motion.driven(carried["motion_input"])
        mean, covariance = self.algorithm.predict(*self.moments(memory), motion, dt)
        return {"mean": mean, "covariance": covariance.reshape(mean.shape[0], -1), **carried}

    def update(self, memory: Memory, observation: Observation, epoch: Epoch) -> tuple[Memory, Innovation]:
        """See `Estimator.update`; a trial without a finite belief is set aside and stays so."""
        mean, covariance = self.moments(memory)
        lost = None
        if not (all_finite(mean) and all_finite(covariance)):
            lost = ~(np.all(np.isfinite(mean), axis=-1) & np.all(np.isfinite(covariance), axis=(-1, -2)))
            mean = np.where(lost[:, None], 1.0, mean)
            covariance = np.where(lost[:, None, None], np.eye(mean.shape[-1]), covariance)
            observation = observation.without(lost[:, None])
        result = self.algorithm.update(mean, covariance, observation, self.model)
        posterior = {**memory, "mean": result.mean, "covariance": result.covariance.reshape(mean.shape[0], -1)}
        if lost is not None:
            posterior = {group: np.where(lost[:, None], np.nan, value) for group, value in posterior.items()}
        return posterior, Innovation(result.innovation, result.nis, result.nis_dof)

    @property
    def plain(self) -> bool:
        """Whether it remembers what its filter knows, and predicts by it, and nothing else."""
        return all(getattr(type(self), name) is getattr(KalmanEstimator, name) for name in ("predict", "moments"))

    def prepare_steps_at_once(self) -> bool:
        """See `Estimator.prepare_steps_at_once`: where prediction and update are those of one compiled call."""
        kind, motion, wiring, n = type(self), self.motion, self.wiring, self.motion.size
        plain = all(getattr(kind, name) is getattr(KalmanEstimator, name) for name in _STEP)
        moves = motion.linear and not motion.input_size and type(motion).equations is MotionModel.equations
        rule = self.algorithm.whole_update(n)
        if not (plain and moves) or wiring.noise_port or rule is None or self.considered:
            return False
        compiled = program(self.model)
        if compiled is None:
            return False
        rows = [list(wiring.stream).index(row) for row in self.model.names]
        ports = Ports(wiring.trials, wiring.platform_trials, wiring.platforms, rows)
        self._linear = Linear(*rule, compiled, n, self._whitener.covariance, ports, RULE)
        return True

    def step_at_once(self, state: Array, dt: float, now: float, stream: Array, platforms: Array) -> bool:
        """See `Estimator.step_at_once`."""
        assert self._linear is not None
        mean = state[: self._size].reshape(-1, self.motion.size)
        matrices = self.motion.transition(mean, dt), self.motion.process_noise(mean, dt)
        return self._linear(state, now, matrices, stream, platforms)
