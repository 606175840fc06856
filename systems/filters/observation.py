"""What one instant tells a filter, and what that is about a state."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.filters.whitening import Whitener, missing_rows
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["Linearised", "Observation", "linearised", "take"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Index = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Observation:
    """What was measured at one instant, from where, and how well.

    Attributes
    ----------
    value : ndarray, shape (trials, m)
        NaN where a row is missing: that row is left out in that trial.
    platforms : ndarray, shape (1 or trials, p, 6)
        Known platforms.
    whitener : Whitener
        The noise covariance that the filter believes in, factored; of all trials, or of each.
    """

    value: Array
    platforms: Array
    whitener: Whitener

    @property
    def noise_covariance(self) -> Array:
        """R, shape (m, m) or (trials, m, m); not to be relied on in rows that are missing."""
        return self.whitener.covariance

    @property
    def sigmas(self) -> Array:
        """Standard deviations of the noise, shape (m,) or (trials, m); as `noise_covariance`."""
        return np.sqrt(np.einsum("...ii->...i", self.whitener.covariance))

    def rows(self, which: Index | Mask) -> Observation:
        """Return that of some trials alone, in the order of `which`; a trial may stand there more than once."""
        return Observation(self.value[which], take(self.platforms, which), self.whitener.rows(which))

    def without(self, missing: Mask) -> Observation:
        """Return this with rows left out; `missing` has the shape (trials, m), or (trials, 1) for all rows of some."""
        return replace(self, value=np.where(missing, np.nan, self.value))

    def with_noise(self, covariance: Array) -> Observation:
        """Return this with another noise covariance (m, m) or (trials, m, m)."""
        return replace(self, whitener=Whitener(covariance))


class Linearised(NamedTuple):
    """An observation about a state: innovation, Jacobian and the matrix that whitens both; 0 in rows that are missing.

    Attributes
    ----------
    innovation : ndarray, shape (trials, m)
    jacobian : ndarray, shape (trials, m, n)
    weight : ndarray, shape (m, m) or (trials, m, m)
    missing : ndarray of bool, shape (trials, m), or None
        Rows that were not measured or for which the model has no value; None: there are none.
    """

    innovation: Array
    jacobian: Array
    weight: Array
    missing: Mask | None


def linearised(observation: Observation, model: MeasurementModel, state: Array) -> Linearised:
    """Return what an observation says about `state` (trials, n), to first order."""
    value, jacobian = model.linearize(state, observation.platforms)
    innovation = model.residual(observation.value, value)
    missing = missing_rows(innovation, jacobian)
    if missing is not None:
        innovation, jacobian = np.where(missing, 0.0, innovation), np.where(missing[..., None], 0.0, jacobian)
    return Linearised(innovation, jacobian, observation.whitener.matrix(missing), missing)


def take(array: Array, which: Index | Mask) -> Array:
    """Return some trials of an array (1 or trials, ...); one that all trials share stays as it is."""
    return array if array.shape[0] == 1 else array[which]
