"""How likely a measurement is for every particle of a cloud."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.filters.observation import Observation, take
from quietfix.systems.kernels.equations import program
from quietfix.systems.kernels.particles.calls import Difference, Look, likelihoods, look, residuals, told
from quietfix.systems.kernels.particles.staging import Shares
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["Likelihood", "Reading"]

Array = NDArray[np.float64]

_AT_ONCE = 20_000  # particles: what fits into a processor's cache; more at once are slower


class Reading:
    """An observation, to be told to clouds.

    Parameters
    ----------
    model : MeasurementModel
        What the filter believes of the sensor.
    observation : Observation
        What was measured.
    """

    def __init__(self, model: MeasurementModel, observation: Observation) -> None:
        self.model, self.observation = model, observation

    def rows(self, which: NDArray[np.intp]) -> Reading:
        """Return what some trials are told."""
        return Reading(self.model, self.observation.rows(which))

    def residual(self, cloud: Array, which: NDArray[np.intp]) -> Difference:
        """Return measured minus predicted for the clouds (len(which), n, N) of some trials."""
        measured, platforms = self.observation.value, self.observation.platforms
        if which.size != measured.shape[0]:
            measured, platforms = measured[which], take(platforms, which)
        compiled = program(self.model)
        if compiled is not None:
            return residuals(compiled, cloud, measured, platforms)
        found, step = np.empty((*measured.shape, cloud.shape[-1])), max(1, _AT_ONCE // cloud.shape[-1])
        for begin in range(0, len(cloud), step):
            some = slice(begin, begin + step)
            seen = platforms[:, None] if platforms.shape[0] == 1 else platforms[some, None]
            predicted = self.model.predict(cloud[some].swapaxes(1, 2), seen)
            found[some] = self.model.residual(measured[some, None], predicted).swapaxes(1, 2)
        return Difference(found, np.count_nonzero(np.isfinite(found), axis=-1))


class Likelihood:
    r"""Gaussian likelihood of a reading, without its constant: :math:`\log\ell_i = -|W (z - h(x_i))|^2/2`.

    Parameters
    ----------
    reading : Reading
        What was measured.
    missing : ndarray of bool, shape (trials, m)
        Rows that are left out.
    """

    def __init__(self, reading: Reading, missing: NDArray[np.bool_]) -> None:
        self._reading, self._missing = reading, missing
        self._weight = reading.observation.whitener.matrix(missing if missing.any() else None)

    def look(self, residual: Array, shares: Shares) -> Look:
        """Return what the reading says of clouds with these weights, from their residuals (trials, m, N)."""
        return look(residual, self._missing, self._weight, shares.weight, shares.alike)

    def __call__(self, clouds: Array, which: NDArray[np.intp]) -> tuple[Array, Array]:
        """Return log likelihoods (len(which), N) of the clouds (all, n, N) of some trials, and the largest of each.

        A particle for which the model has no value has likelihood 0.
        """
        compiled, reading = program(self._reading.model), self._reading.observation
        if compiled is not None:
            given = reading.value, reading.platforms, self._missing, self._weight
            return told(compiled, clouds, which, *given)
        residual = self._reading.residual(clouds[which], which).rows
        weight = self._weight if self._weight.ndim == 2 else self._weight[which]
        logarithm = likelihoods(residual, self._missing[which], weight)[1]
        return logarithm, logarithm.max(axis=-1)
