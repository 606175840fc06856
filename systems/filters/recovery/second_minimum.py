r"""A way out of a second minimum, for updates that minimise a cost.

The posterior's mode minimises

.. math:: J(x) = (x - \bar x)^T P^{-1} (x - \bar x) + (z - h(x))^T R^{-1} (z - h(x)),

which where the model is right is at its minimum about chi-square with as many degrees of freedom as there are rows.
Gauss-Newton may end in a minimum in which it is not, and neither damping nor a line search leaves that. Where J is
improbable, another search starts from the mean of an unscented update, which does not hang on one tangent, by Levenberg
and Marquardt's method (Nocedal and Wright, *Numerical Optimization*, 2006, section 10.3); what it finds is kept where J
falls by more than a stop rule explains. An epoch that cannot fix the state by itself is left alone: there a large J
says that prior and measurement contradict each other, and the measurement alone is no better guide.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from quietfix.systems.filters.gaussian import GaussianFilter, WrappingFilter
from quietfix.systems.filters.iterated_extended import IteratedExtendedKalman
from quietfix.systems.filters.observation import Observation, linearised
from quietfix.systems.filters.square_root import Gains, Posterior
from quietfix.systems.filters.unscented import UnscentedKalman
from quietfix.systems.linear_algebra import cholesky
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["SecondMinimum", "cost"]

Array = NDArray[np.float64]

_IMPROBABLE = 1e-4
_FALL = 1.0  # of the cost: another minimum, not another digit of the same
_STEPS = 40
_DAMPING = (1e-3, 10.0, 1e12)  # at first, factor, and where a search gives up
_SMALL = 1e-6  # sigmas of the prior: a step that ends the search


class _Cost(NamedTuple):
    """The cost at some states, and what a step from there needs: all in units of the prior's root and the noise."""

    total: Array
    residual: Array
    rows: Array
    used: Array


def _cost(there: Array, root: Array, mean: Array, observation: Observation, model: MeasurementModel) -> _Cost:
    """Return the cost at mean + L y for y = `there` (trials, n); infinite where the model has no value."""
    told = linearised(observation, model, mean + _times(root, there))
    measured = np.isfinite(observation.value)
    gone = np.zeros(measured.shape, bool) if told.missing is None else told.missing
    residual = _times(told.weight, told.innovation)
    total = np.einsum("...i,...i->...", residual, residual) + np.einsum("...i,...i->...", there, there)
    # a row that is measured and has no value there would cost nothing
    total = np.where(np.any(measured & gone, axis=-1) | ~np.isfinite(total), np.inf, total)
    return _Cost(total, residual, told.weight @ (told.jacobian @ root), (~gone).sum(axis=-1))


def cost(
    state: Array, mean: Array, covariance: Array, observation: Observation, model: MeasurementModel
) -> tuple[Array, Array]:
    """Return J at `state` (trials, n) for a prior of `mean` and `covariance`, and how many rows are in it.

    Infinite where the state is not finite, or a row that is measured has no value there.
    """
    root = cholesky(covariance)
    finite = np.asarray(np.isfinite(state).all(axis=-1, keepdims=True))
    there = _steps(root, np.where(finite, state, mean) - mean)
    found = _cost(there, root, mean, observation, model)
    return np.where(finite[:, 0], found.total, np.inf), found.used


@dataclass(frozen=True)
class SecondMinimum(WrappingFilter):
    """A filter whose update is tried again from elsewhere where it has ended in a minimum that cannot be the right one.

    Parameters
    ----------
    algorithm : GaussianFilter
        The filter; its update minimises J.
    """

    algorithm: GaussianFilter = field(default_factory=IteratedExtendedKalman)

    def update(self, mean: Array, covariance: Array, observation: Observation, model: MeasurementModel) -> Posterior:
        """See `GaussianFilter.update`."""
        result = self.algorithm.update(mean, covariance, observation, model)
        n = mean.shape[-1]
        fixes = result.nis_dof >= n
        if not fixes.any():
            return result
        reached, rows = cost(result.mean, mean, covariance, observation, model)
        doubtful = np.flatnonzero(fixes & ~(reached <= chi2.isf(_IMPROBABLE, np.maximum(rows, 1))))
        if doubtful.size == 0:
            return result
        prior = mean[doubtful], covariance[doubtful]
        state, posterior, total = _search(*prior, observation.rows(doubtful), model)
        better = total < reached[doubtful] - _FALL
        if not better.any():
            return result
        chosen = doubtful[better]
        found = result.mean.copy(), result.covariance.copy()
        found[0][chosen], found[1][chosen] = state[better], posterior[better]
        return result._replace(mean=found[0], covariance=found[1])


def _search(
    mean: Array, covariance: Array, observation: Observation, model: MeasurementModel
) -> tuple[Array, Array, Array]:
    """Return where Levenberg and Marquardt's search from an unscented update ends, the covariance there, and J.

    J is infinite in a trial whose rows do not fix the state there.
    """
    begun = UnscentedKalman().update(mean, covariance, observation, model).mean
    root = cholesky(covariance)
    finite = np.isfinite(begun).all(axis=-1, keepdims=True)
    there = _steps(root, np.where(finite, begun, mean) - mean)
    damping = np.full(mean.shape[0], _DAMPING[0])
    now = _cost(there, root, mean, observation, model)
    active = np.isfinite(now.total)
    unit = np.eye(mean.shape[-1])
    for _ in range(_STEPS):
        if not active.any():
            break
        columns = np.swapaxes(now.rows, -1, -2)
        curved = columns @ now.rows + unit
        downhill = _times(columns, now.residual) - there
        scale = damping[:, None] * np.einsum("...ii->...i", curved)
        step = np.where(active[:, None], _steps(curved + scale[..., None] * unit, downhill), 0.0)
        new = _cost(there + step, root, mean, observation, model)
        falls = active & (new.total < now.total)
        small = np.einsum("...i,...i->...", step, step) < _SMALL**2
        there = np.where(falls[:, None], there + step, there)
        now = _Cost(*(np.where(_wide(falls, a), b, a) for a, b in zip(now, new, strict=True)))
        damping = np.where(falls, damping / _DAMPING[1], damping * _DAMPING[1])
        active &= ~small & (damping < _DAMPING[2])
    gains = Gains(root, now.rows)
    total = np.where(_fixed(now.rows), now.total, np.inf)
    return mean + _times(root, there), gains.covariance(), total


def _steps(matrix: Array, vector: Array) -> Array:
    """Return the solutions of (..., n, n) x = (..., n)."""
    solved = np.linalg.solve(matrix, vector[..., None])[..., 0]
    return solved.astype(float, copy=False)


def _times(matrix: Array, vector: Array) -> Array:
    product: Array = (matrix @ vector[..., None])[..., 0]
    return product


def _wide(mask: NDArray[np.bool_], like: Array) -> NDArray[np.bool_]:
    return mask.reshape(mask.shape + (1,) * (like.ndim - 1))


def _fixed(rows: Array) -> NDArray[np.bool_]:
    """Return whether rows alone fix a state, to the digits that numbers have."""
    values = np.linalg.svd(np.where(np.isfinite(rows), rows, 0.0), compute_uv=False)
    fixed: NDArray[np.bool_] = values[..., rows.shape[-1] - 1] > 1e-12 * values[..., 0]
    return fixed
