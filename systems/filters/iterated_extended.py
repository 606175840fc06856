"""The iterated extended Kalman filter, and with one iteration the extended Kalman filter."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from systems.filters.gaussian import GaussianFilter, take
from systems.filters.linear_algebra import cholesky
from systems.filters.square_root import Gains, Posterior, statistic
from systems.filters.whitening import Whitener, missing_rows
from systems.measurement.base import MeasurementModel

__all__ = ["IteratedExtendedKalman"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class IteratedExtendedKalman(GaussianFilter):
    r"""Gauss-Newton on the posterior: relinearise until the state no longer moves.

    .. math:: x^{j+1} = x^0 + K^j\,[z - h(x^j) - H^j (x^0 - x^j)], \qquad
              \|x^{j+1} - x^j\| \le \varepsilon \Rightarrow \text{stop}

    Bell and Cathey, *The iterated Kalman filter update as a Gauss-Newton method*, IEEE Trans. Automatic
    Control 38 (1993) 294-297; section 2.2 of Xu, Su and Wang, doi 10.20079/j.issn.1001-893x.220609005. A trial stops
    when it has converged itself; the others go on without it, and none changes another's result.

    Parameters
    ----------
    max_iterations : int
        At most so many linearisations, >= 1; 1 is the extended Kalman filter.
    tolerance : float
        epsilon, in the mixed SI units of the state (as the paper has it: metres dominate), > 0.
    """

    max_iterations: int = 10
    tolerance: float = 1e-2

    def __post_init__(self) -> None:
        """Check the arguments."""
        if self.max_iterations < 1:
            raise ValueError(f"max_iterations: {self.max_iterations} is not allowed; a whole number >= 1")
        if not (math.isfinite(self.tolerance) and self.tolerance > 0):
            raise ValueError(f"tolerance: {self.tolerance} is not allowed; a finite number > 0")

    def update(
        self,
        mean: Array,
        covariance: Array,
        measurement: Array,
        platforms: Array,
        model: MeasurementModel,
        whitener: Whitener,
    ) -> Posterior:
        """See `GaussianFilter.update`."""
        root = cholesky(covariance)
        value, jacobian = model.linearize(mean, platforms)
        innovation = model.residual(measurement, value)
        missing = missing_rows(innovation, jacobian.sum(axis=-1))
        if missing is not None:
            innovation, jacobian = _without(missing, innovation, jacobian)
        w = whitener.matrix(missing)
        rows = w @ (jacobian @ root)
        whitened = np.einsum("...ij,...j->...i", w, innovation)
        gain = Gains(root, rows)
        state = mean + gain.correction(whitened)
        final_rows = rows
        nis = statistic(rows, whitened)

        active = np.arange(mean.shape[0])
        step = state - mean
        for _ in range(self.max_iterations - 1):
            # A state that is not finite cannot be improved either.
            moving = np.einsum("...i,...i->...", step, step) > self.tolerance**2
            if not moving.any():
                break
            if not moving.all():
                active = active[moving]
            here, prior, factor = state[active], mean[active], root[active]
            value, jacobian = model.linearize(here, take(platforms, active))
            residual = model.residual(measurement[active], value)
            if missing is not None:
                residual, jacobian = _without(missing[active], residual, jacobian)
            weight = w if w.ndim == 2 else w[active]
            local = weight @ (jacobian @ factor)
            pulled = residual - np.einsum("...mi,...i->...m", jacobian, prior - here)
            moved = prior + Gains(factor, local).correction(np.einsum("...ij,...j->...i", weight, pulled))
            step = moved - here
            state[active] = moved
            if final_rows is rows:
                final_rows = rows.copy()
            final_rows[active] = local

        posterior = gain if final_rows is rows else Gains(root, final_rows)
        if missing is None:
            used = np.full(mean.shape[0], float(model.size))
        else:
            innovation = np.where(missing, np.nan, innovation)
            used = np.count_nonzero(~missing, axis=-1).astype(float)
            nis = np.where(used > 0, nis, np.nan)
        return Posterior(state, posterior.covariance(), innovation, nis, used)


def _without(missing: NDArray[np.bool_], residual: Array, jacobian: Array) -> tuple[Array, Array]:
    return np.where(missing, 0.0, residual), np.where(missing[..., None], 0.0, jacobian)
