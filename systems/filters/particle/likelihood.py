"""How likely a measurement is for every particle of a cloud."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.filters.observation import Observation, take
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["Likelihood", "Reading"]

Array = NDArray[np.float64]


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

    def residual(self, cloud: Array, which: NDArray[np.intp]) -> Array:
        """Return measured minus predicted (len(which), N, m) for the clouds (len(which), n, N) of some trials."""
        measured, platforms = self.observation.value, self.observation.platforms
        if which.size != measured.shape[0]:
            measured, platforms = measured[which], take(platforms, which)
        predicted = self.model.predict(cloud.swapaxes(1, 2), platforms[:, None])
        return self.model.residual(measured[:, None], predicted)


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
        root = reading.observation.whitener.matrix(missing if missing.any() else None)
        # Rows that are independent, as they mostly are, need no product of matrices per particle.
        diagonal = np.einsum("...ii->...i", root)
        self._diagonal = bool(np.all(root == diagonal[..., None] * np.eye(root.shape[-1])))
        self._root = diagonal if self._diagonal else root

    def __call__(self, cloud: Array, which: NDArray[np.intp], residual: Array | None = None) -> tuple[Array, Array]:
        """Return log likelihoods (len(which), N) and whitened residuals (len(which), N, m).

        A particle for which the model has no value has likelihood 0.

        Parameters
        ----------
        cloud : ndarray, shape (len(which), n, N)
        which : ndarray of int
            Whose clouds these are.
        residual : ndarray, shape (len(which), N, m), optional
            As `Reading.residual` gives it, if it is known.
        """
        if residual is None:
            residual = self._reading.residual(cloud, which)
        missing = self._missing[which]
        if missing.any():
            residual = np.where(missing[:, None], 0.0, residual)
        root = self._root if self._root.ndim == (1 if self._diagonal else 2) else self._root[which]
        if self._diagonal:
            white = residual * (root if root.ndim == 1 else root[:, None])
        else:
            white = residual @ np.swapaxes(root, -1, -2)
        log_likelihood = np.einsum("...i,...i->...", white, white)
        log_likelihood *= -0.5
        if not np.isfinite(np.sum(log_likelihood)):
            impossible = ~np.isfinite(log_likelihood)
            log_likelihood[impossible] = -np.inf
            white[impossible] = 0.0
        return log_likelihood, white
