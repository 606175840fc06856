"""Maximum a posteriori over a sliding window as an estimator block."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.batch.solving import Rule, solve
from quietfix.systems.batch.window import Path, Window
from quietfix.systems.estimators.base import Estimator
from quietfix.systems.estimators.memory import Epoch, Innovation, Memory
from quietfix.systems.estimators.wiring import Wiring
from quietfix.systems.filters.gaussian import predict_extended
from quietfix.systems.filters.observation import Observation, linearised
from quietfix.systems.filters.square_root import Gains, report
from quietfix.systems.filters.whitening import Whitener
from quietfix.systems.linear_algebra import cholesky, semidefinite_root
from quietfix.systems.measurement.base import MeasurementModel
from quietfix.systems.motion.base import MotionModel
from quietfix.systems.starts.start import Start

__all__ = ["BatchEstimator"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


class BatchEstimator(Estimator):
    r"""At every epoch the most probable path through the last ones, measured and pushed as they were.

    The states of the window and the process noise between them are unknowns (full maximum a posteriori), solved by
    Levenberg-Marquardt; see `quietfix.systems.batch.window.Window`. What leaves the window becomes the prior of its
    first epoch, linearised once and for all where the solution then has it: the arrival cost of Rao, Rawlings and
    Mayne, IEEE Trans. Automatic Control 48 (2003) 246-258. Of a linear Gaussian system it is the Kalman filter,
    whatever the window; with one epoch it is the iterated extended Kalman filter, damped.

    The innovation is against the prediction from the epoch before, as that of an extended Kalman filter.

    .. math:: \min_{x_0, u}\ |L_0^{-1}(x_0 - m_0)|^2 + \sum_k |u_k|^2 + \sum_k |W_k (z_k - h(x_k))|^2, \qquad
              x_k = f(x_{k-1}) + L_k u_k

    Parameters
    ----------
    name : str
        Name of the block.
    epochs : int
        How many the window has, >= 1.
    rule : Rule
        When to stop, and which rows are left out.
    model, motion, start, wiring
        See `Estimator`.

    Raises
    ------
    ValueError
        For a motion that is driven by an input, and where the noise has tails.
    """

    def __init__(
        self,
        name: str,
        epochs: int,
        rule: Rule,
        model: MeasurementModel,
        motion: MotionModel,
        start: Start,
        wiring: Wiring,
    ) -> None:
        if motion.input_size:
            raise ValueError(
                f"estimators.{name}: a window is not allowed where the motion is driven by its own estimate"
            )
        if wiring.tails is not None:
            raise ValueError(
                f"estimators.{name}: a window is not allowed where the noise has tails; edit_sigmas leaves rows out"
            )
        self.epochs, self.rule = epochs, rule
        super().__init__(name, model, motion, start, wiring)

    def memory_sizes(self) -> Mapping[str, int]:
        """See `Estimator.memory_sizes`: what is known now, and the window, whose last epoch is now.

        ``steps`` is NaN at epochs before a trial's first one, and 0 at that.
        """
        n, k = self.motion.size, self.epochs
        now = {"mean": n, "covariance": n * n}
        prior = {"prior_mean": n, "prior_covariance": n * n, "first": n, "pushes": k * n}
        m = self.model.size
        noise = {"noise": k * m * m} if self.wiring.noise_port else {}
        return {**now, **prior, "steps": k, "rows": k * m, "sites": k * 6 * self.wiring.platforms, **noise}

    def begin(self, mean: Array, covariance: Array, epoch: Epoch) -> Memory:
        """See `Estimator.begin`."""
        trials = mean.shape[0]
        memory = {name: np.full((trials, size), np.nan) for name, size in self.memory_sizes().items()}
        for name in ("mean", "prior_mean", "first"):
            memory[name] = np.array(mean)
        for name in ("covariance", "prior_covariance"):
            memory[name] = np.reshape(covariance, (trials, -1)).copy()
        memory["pushes"][:], memory["sites"][:] = 0.0, 0.0
        memory["steps"][:, -1] = 0.0
        return memory

    def moments(self, memory: Memory) -> tuple[Array, Array]:
        """See `Estimator.moments`."""
        n = self.motion.size
        return memory["mean"], memory["covariance"].reshape(-1, n, n)

    def predict(self, memory: Memory, dt: float, epoch: Epoch) -> Memory:
        """See `Estimator.predict`: one more epoch, of which nothing is measured yet; the oldest one may leave."""
        memory = {name: np.array(values) for name, values in memory.items()}
        mean, covariance = predict_extended(*self.moments(memory), self.motion, dt)
        trials = mean.shape[0]
        leaves: Any = np.isfinite(memory["steps"][:, 0]) & np.isfinite(memory["first"]).all(axis=-1)
        if leaves.any():
            self._let_go(memory, leaves, dt)
        for name in ("pushes", "steps", "rows", "sites", *(["noise"] if "noise" in memory else [])):
            slots = np.roll(memory[name].reshape(trials, self.epochs, -1), -1, axis=1)
            slots[:, -1] = {"pushes": 0.0, "steps": dt, "rows": np.nan}.get(name, slots[:, max(self.epochs - 2, 0)])
            memory[name] = slots.reshape(trials, -1)
        memory["steps"][leaves, 0] = 0.0
        memory["mean"], memory["covariance"] = mean, covariance.reshape(trials, -1)
        return memory

    def _let_go(self, memory: Memory, leaves: Mask, dt: float) -> None:
        """Make of the oldest epoch's measurement, and the step after it, the prior of the next one."""
        n, k = self.motion.size, self.epochs
        trials = len(leaves)
        first = np.where(leaves[:, None], memory["first"], 1.0)
        mean = np.where(leaves[:, None], memory["prior_mean"], 1.0)
        covariance = memory["prior_covariance"].reshape(-1, n, n)
        root = cholesky(np.where(leaves[:, None, None], covariance, np.eye(n)))
        value = memory["rows"].reshape(trials, k, -1)[:, 0]
        one = linearised(self._observed(value, memory, 0), self.model, first)
        off = first - mean
        left = one.innovation + (one.jacobian @ off[..., None])[..., 0]
        if self.rule.edit_sigmas is not None:
            out = np.abs(one.innovation) > self.rule.edit_sigmas * self._observed(value, memory, 0).sigmas
            one = linearised(self._observed(np.where(out, np.nan, value), memory, 0), self.model, first)
            left = np.where(out, 0.0, left)
        gains = Gains(root, one.weight @ (one.jacobian @ root))
        after = mean + gains.correction((one.weight @ left[..., None])[..., 0])
        step = dt if k == 1 else float(np.nanmax(np.where(leaves, memory["steps"][:, 1], np.nan)))
        transition, noise = self.motion.transition(first, step), self.motion.process_noise(first, step)
        there = self.motion.propagate(first, step)
        moved = there + (transition @ (after - first)[..., None])[..., 0]
        half = transition @ gains.root()
        spread = half @ np.swapaxes(half, -1, -2) + noise
        if k > 1:
            push = memory["pushes"].reshape(trials, k, n)[:, 1]
            there = there + (semidefinite_root(noise) @ push[..., None])[..., 0]
        else:
            there = moved
        memory["first"] = np.where(leaves[:, None], there, memory["first"])
        memory["prior_mean"] = np.where(leaves[:, None], moved, memory["prior_mean"])
        flat = spread.reshape(trials, -1)
        memory["prior_covariance"] = np.where(leaves[:, None], flat, memory["prior_covariance"])

    def _observed(self, value: Array, memory: Memory, slot: int) -> Observation:
        trials, m = value.shape
        sites = memory["sites"].reshape(trials, self.epochs, -1, 6)[:, slot]
        if not self.wiring.noise_port:
            return Observation(value, sites, self._whitener)
        noise = memory["noise"].reshape(trials, self.epochs, m, m)[:, slot]
        nothing = np.isnan(value)
        gone = nothing[:, :, None] | nothing[:, None, :]
        return Observation(value, sites, Whitener(np.where(gone, np.eye(m), noise)))

    def update(self, memory: Memory, observation: Observation, epoch: Epoch) -> tuple[Memory, Innovation]:
        """See `Estimator.update`; a trial without a finite belief is set aside and stays so."""
        memory = {name: np.array(values) for name, values in memory.items()}
        trials, n, k = self.wiring.trials, self.motion.size, self.epochs
        mean, covariance = self.moments(memory)
        well: Any = np.isfinite(mean).all(axis=-1) & np.isfinite(covariance).all(axis=(-1, -2))
        well = well & np.isfinite(memory["prior_covariance"]).all(axis=-1) & np.isfinite(memory["first"]).all(axis=-1)
        memory["rows"].reshape(trials, k, -1)[:, -1] = observation.value
        memory["sites"].reshape(trials, k, -1)[:, -1] = observation.platforms.reshape(
            observation.platforms.shape[0], -1
        )
        if "noise" in memory:
            memory["noise"].reshape(trials, k, -1)[:, -1] = observation.noise_covariance.reshape(trials, -1)
        rows = np.where(well[:, None], memory["rows"], np.nan).reshape(trials, k, -1)
        innovation = self._innovation(
            np.where(well[:, None], mean, 1.0),
            np.where(well[:, None, None], covariance, np.eye(n)),
            observation.without(~well[:, None]),
        )
        path = Path(
            np.where(well[:, None], memory["first"], 1.0),
            np.where(well[:, None], memory["pushes"], 0.0).reshape(trials, k, n),
        )
        found = solve(self._window(memory, well, rows, path.first), path, self.rule)
        memory["mean"] = np.where(well[:, None], found.states[-1], np.nan)
        memory["covariance"] = np.where(well[:, None], found.covariance.reshape(trials, -1), np.nan)
        memory["first"] = np.where(well[:, None], found.path.first, np.nan)
        memory["pushes"] = found.path.pushes.reshape(trials, -1)
        return memory, innovation

    def _window(self, memory: Memory, well: Mask, rows: Array, first: Array) -> Window:
        n, k = self.motion.size, self.epochs
        steps = np.where(well[:, None], memory["steps"], np.nan)
        moves = steps > 0
        spans = [float(steps[moves[:, i], i][0]) if moves[:, i].any() else 0.0 for i in range(k)]
        noises = [self.motion.process_noise(first, span) if span > 0 else np.zeros((n, n)) for span in spans]
        return Window(
            np.where(well[:, None], memory["prior_mean"], 1.0),
            np.where(well[:, None], memory["prior_covariance"], np.eye(n).ravel()).reshape(-1, n, n),
            spans,
            moves,
            [self._observed(rows[:, i], memory, i) for i in range(k)],
            self.model,
            self.motion,
            noises,
        )

    def _innovation(self, mean: Array, covariance: Array, observation: Observation) -> Innovation:
        one = linearised(observation, self.model, mean)
        root = cholesky(covariance)
        _, nis = Gains(root, one.weight @ (one.jacobian @ root)).update(
            (one.weight @ one.innovation[..., None])[..., 0]
        )
        told = report(mean, covariance, one.innovation, nis, one.missing)
        return Innovation(told.innovation, told.nis, told.nis_dof)
