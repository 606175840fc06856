"""The iterated extended Kalman filter, and with one iteration the extended Kalman filter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.documented import count, number
from quietfix.systems.filters.gaussian import GaussianFilter
from quietfix.systems.filters.observation import Observation, linearised, take
from quietfix.systems.filters.square_root import Gains, Posterior, report
from quietfix.systems.kernels.equations import program
from quietfix.systems.kernels.updating import EXTENDED, Update, extended, settings
from quietfix.systems.linear_algebra import cholesky
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["IteratedExtendedKalman"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class IteratedExtendedKalman(GaussianFilter):
    r"""Gauss-Newton on the posterior: relinearise until the state no longer moves.

    .. math:: x^{j+1} = x^0 + K^j\,[z - h(x^j) - H^j (x^0 - x^j)], \qquad
              \|x^{j+1} - x^j\| \le \varepsilon \Rightarrow \text{stop}

    Bell and Cathey, *The iterated Kalman filter update as a Gauss-Newton method*, IEEE Trans. Automatic
    Control 38 (1993) 294-297; section 2.2 of Xu, Su and Wang, doi 10.20079/j.issn.1001-893x.220609005. A trial stops
    when it has converged itself, or where its next iterate is not finite; the others go on without it, and none
    changes another's result.

    Parameters
    ----------
    max_iterations : int
        At most so many linearisations, >= 1; 1 is the extended Kalman filter.
    tolerance : float
        epsilon, in the mixed SI units of the state (as the paper has it: metres dominate), > 0.
    """

    max_iterations: int = count("at most so many linearisations per update; 1 is the EKF", 10)
    tolerance: float = number("stop rule ||x_{j+1} - x_j|| <= tolerance, SI units mixed", 1e-2, above=0)

    def __post_init__(self) -> None:
        """Check the arguments."""
        if self.max_iterations < 1:
            raise ValueError(f"max_iterations: {self.max_iterations} is not allowed; a whole number >= 1")
        if not (math.isfinite(self.tolerance) and self.tolerance > 0):
            raise ValueError(f"tolerance: {self.tolerance} is not allowed; a finite number > 0")

    def whole_update(self, states: int) -> tuple[Update, Array] | None:
        """See `GaussianFilter.whole_update`."""
        kind = type(self)
        if kind.update is not IteratedExtendedKalman.update or kind.predict is not GaussianFilter.predict:
            return None
        return EXTENDED, settings(self.max_iterations, self.tolerance)

    def update(self, mean: Array, covariance: Array, observation: Observation, model: MeasurementModel) -> Posterior:
        """See `GaussianFilter.update`."""
        compiled = program(model)
        if compiled is not None:
            return Posterior(
                *extended(
                    mean,
                    covariance,
                    observation.value,
                    observation.platforms,
                    observation.noise_covariance,
                    compiled,
                    self.max_iterations,
                    self.tolerance,
                )
            )
        root = cholesky(covariance)
        innovation, jacobian, weight, missing = linearised(observation, model, mean)
        gains = Gains(root, weight @ (jacobian @ root))
        step, nis = gains.update((weight @ innovation[..., None])[..., 0])
        state = mean + step
        if self.max_iterations > 1:
            trials = _Trials(mean, root, observation.value, observation.platforms, weight, missing)
            gains = self._iterate(trials, model, state, step, gains)

        return report(state, gains.covariance(), innovation, nis, missing)

    def _iterate(self, trials: _Trials, model: MeasurementModel, state: Array, step: Array, gains: Gains) -> Gains:
        """Move `state` to where each trial converges; return the gains of every trial's last linearisation."""
        root, rows = trials.root, gains.rows
        active: NDArray[np.intp] | None = None  # all
        for _ in range(self.max_iterations - 1):
            moving = np.einsum("...i,...i->...", step, step) > self.tolerance**2
            if not moving.any():
                break
            if not moving.all():
                active = np.flatnonzero(moving) if active is None else active[moving]
                trials = trials.rows(moving)
            here = state if active is None else state[active]
            value, jacobian = model.linearize(here, trials.platforms)
            residual = model.residual(trials.measurement, value)
            if trials.missing is not None:
                residual = np.where(trials.missing, 0.0, residual)
                jacobian = np.where(trials.missing[..., None], 0.0, jacobian)
            local = trials.weight @ (jacobian @ trials.root)
            pulled = residual + (jacobian @ (here - trials.mean)[..., None])[..., 0]
            correction = Gains(trials.root, local).correction((trials.weight @ pulled[..., None])[..., 0])
            moved = trials.mean + correction
            if not np.isfinite(np.sum(moved)):
                # An iterate outside of where the model is defined: such a trial stays at the one before.
                lost = ~np.all(np.isfinite(moved), axis=-1)
                moved = np.where(lost[:, None], here, moved)
                local = np.where(lost[:, None, None], rows if active is None else rows[active], local)
            step = moved - here
            if active is None:
                state[:], rows = moved, local
            else:
                rows = rows.copy() if rows is gains.rows else rows
                state[active], rows[active] = moved, local
        return gains if rows is gains.rows else Gains(root, rows)


class _Trials(NamedTuple):
    """What stays the same while a trial iterates."""

    mean: Array
    root: Array
    measurement: Array
    platforms: Array
    weight: Array
    missing: NDArray[np.bool_] | None

    def rows(self, which: NDArray[np.bool_]) -> _Trials:
        """Return some trials alone."""
        return _Trials(
            self.mean[which],
            self.root[which],
            self.measurement[which],
            take(self.platforms, which),
            self.weight if self.weight.ndim == 2 else self.weight[which],
            None if self.missing is None else self.missing[which],
        )
