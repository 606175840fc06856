"""What a belief says of a measurement before it is used: the innovation and how far it may lie."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.whitening import missing_rows
from quietfix.systems.kernels.equations import program
from quietfix.systems.kernels.recovery.calls import screened
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["Screened", "screen"]

Array = NDArray[np.float64]


class Screened(NamedTuple):
    """Innovations under a belief.

    Attributes
    ----------
    innovation : ndarray, shape (trials, m)
        NaN in rows that are missing, and in a trial whose belief is not finite.
    own : ndarray, shape (trials, m, m)
        H P H', what the belief's own error does to them; 0 there.
    noise : ndarray, shape (trials, m, m)
        R; not to be relied on there.
    """

    innovation: Array
    own: Array
    noise: Array

    @property
    def spread(self) -> Array:
        """S = H P H' + R, shape (trials, m, m)."""
        return self.own + self.noise

    @property
    def own_variances(self) -> Array:
        """The diagonal of `own`, shape (trials, m)."""
        return np.einsum("...ii->...i", self.own)

    @property
    def noise_variances(self) -> Array:
        """The diagonal of `noise`, shape (trials, m)."""
        return np.einsum("...ii->...i", self.noise)


def screen(mean: Array, covariance: Array, observation: Observation, model: MeasurementModel) -> Screened:
    """Return the innovations of an observation and their spread, linearised at the prediction.

    Parameters
    ----------
    mean, covariance : ndarray, shapes (trials, n) and (trials, n, n)
        Of the prediction.
    observation : Observation
        What was measured.
    model : MeasurementModel
        What the filter believes of the sensor.
    """
    m = observation.value.shape[-1]
    noise = np.broadcast_to(observation.noise_covariance, (mean.shape[0], m, m))
    compiled = program(model)
    if compiled is not None:
        return Screened(*screened(mean, covariance, observation.value, observation.platforms, compiled), noise)
    value, jacobian = model.linearize(mean, observation.platforms)
    innovation = model.residual(observation.value, value)
    missing = missing_rows(innovation, jacobian)
    if missing is not None:
        innovation, jacobian = np.where(missing, np.nan, innovation), np.where(missing[..., None], 0.0, jacobian)
    return Screened(innovation, jacobian @ covariance @ np.swapaxes(jacobian, -1, -2), noise)
