"""A monitor for jumps of a bias that all rows share, and a gate for samples in which only some rows have jumped."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.filters.gaussian import GaussianFilter, WrappingFilter
from quietfix.systems.filters.observation import Observation
from quietfix.systems.filters.square_root import Posterior
from quietfix.systems.filters.unscented import UnscentedKalman
from quietfix.systems.filters.whitening import Whitener, missing_rows
from quietfix.systems.linear_algebra import cholesky
from quietfix.systems.measurement.base import MeasurementModel

__all__ = ["CommonModeMonitor", "common_mode_statistics"]

Array = NDArray[np.float64]


def common_mode_statistics(
    covariance: Array, innovation: Array, jacobian: Array, whitener: Whitener, state: int
) -> tuple[Array, Array, Array]:
    r"""Split the normalised innovation squared into the part of a common jump and the rest.

    .. math:: g = \frac{(c^T S^{-1}\nu)^2}{c^T S^{-1} c}, \qquad n = \nu^T S^{-1}\nu - g, \qquad c = H e_s

    g is the generalised likelihood ratio (times two) of "state s has jumped by an unknown amount" against "nothing has
    happened", chi-square with 1 degree of freedom; n, with one fewer than there are rows, does not see such a jump.
    Willsky and Jones, IEEE Trans. Automatic Control 21 (1976) 108.

    Parameters
    ----------
    covariance : ndarray, shape (..., n, n)
        Of the prediction.
    innovation : ndarray, shape (..., m)
        NaN where a row is missing.
    jacobian : ndarray, shape (..., m, n)
    whitener : Whitener
        Noise of the rows.
    state : int
        s.

    Returns
    -------
    common, rest, jump : ndarray, shape (...)
        g, n, and the jump estimated from the rows alone, :math:`c^T R^{-1}\nu / c^T R^{-1} c`; 0 without rows.
    """
    missing = missing_rows(innovation, jacobian.sum(axis=-1))
    if missing is not None:
        innovation = np.where(missing, 0.0, innovation)
        jacobian = np.where(missing[..., None], 0.0, jacobian)
    w = whitener.matrix(missing)
    whitened = np.einsum("...ij,...j->...i", w, innovation)
    common = np.einsum("...ij,...j->...i", w, jacobian[..., state])
    rows = w @ (jacobian @ cholesky(covariance))
    s = rows @ np.swapaxes(rows, -1, -2) + np.eye(rows.shape[-2])
    solved = np.linalg.solve(s, np.stack([whitened, common], axis=-1))
    across = np.einsum("...i,...i->...", common, solved[..., 0])
    weight = np.einsum("...i,...i->...", common, solved[..., 1])
    total = np.einsum("...i,...i->...", whitened, solved[..., 0])
    power = np.einsum("...i,...i->...", common, common)
    some = power > 0
    g = np.where(some, across**2 / np.where(some, weight, 1.0), 0.0)
    jump = np.einsum("...i,...i->...", common, whitened) / np.where(some, power, 1.0)
    return g, np.maximum(total - g, 0.0), np.where(some, jump, 0.0)


@dataclass(frozen=True)
class CommonModeMonitor(WrappingFilter):
    r"""Any Gaussian filter, with two tests before its update.

    *Gate*: where the common-mode-free statistic n exceeds `gate`, some rows have switched and others not yet; the
    trial does without this sample. *Switch*: where g exceeds `switch`, all rows have jumped together; the state's
    mean is moved by the jump and its covariance opened up, uncorrelated with the other states, before the update.

    A plain test of the NIS cannot do either: at staging it is as large as at a switch, while g stays small there.

    With g and n as in `common_mode_statistics`, and the jump estimated from the rows alone:

    .. math:: g = \frac{(c^T S^{-1}\nu)^2}{c^T S^{-1} c}, \qquad n = \nu^T S^{-1}\nu - g, \qquad
              \Delta = \frac{c^T R^{-1}\nu}{c^T R^{-1} c}, \qquad c = H e_s

    Parameters
    ----------
    algorithm : GaussianFilter
        The filter.
    state : int
        The state that all rows share.
    switch : float
        Threshold of g, > 0; 100 is ten sigma. Infinite: no test.
    gate : float
        Threshold of n, > 0. Staging must pass: a jump of 50 m/s^2 is 2.5 m/s in a sample of 0.05 s, 83 sigma at
        0.03 m/s, n about 7e3 (1e5 over a few samples in a filter that is blind to it); a station that is late by one
        sample is off by the jump of the bias, thousands of m/s, n about 5e9. Infinite: no gate.
    reset_sigma : float
        Standard deviation of the state after a switch, in its unit, > 0.
    """

    algorithm: GaussianFilter = field(default_factory=UnscentedKalman)
    state: int = -1
    switch: float = 100.0
    gate: float = 1e6
    reset_sigma: float = 1e4

    def __post_init__(self) -> None:
        """Check the arguments."""
        for name in ("switch", "gate", "reset_sigma"):
            value = getattr(self, name)
            if math.isnan(value) or value <= 0:
                raise ValueError(f"{name}: {value} is not allowed; a number > 0")

    def update(self, mean: Array, covariance: Array, observation: Observation, model: MeasurementModel) -> Posterior:
        """See `GaussianFilter.update`."""
        value, jacobian = model.linearize(mean, observation.platforms)
        innovation = model.residual(observation.value, value)
        g, n, jump = common_mode_statistics(covariance, innovation, jacobian, observation.whitener, self.state)
        mixed = n > self.gate
        if mixed.any():
            observation = observation.without(mixed[..., None])
        switched = (g > self.switch) & ~mixed
        if switched.any():
            mean, covariance = mean.copy(), covariance.copy()
            mean[switched, self.state] += jump[switched]
            covariance[switched, self.state, :] = 0.0
            covariance[switched, :, self.state] = 0.0
            covariance[switched, self.state, self.state] = self.reset_sigma**2
        return self.algorithm.update(mean, covariance, observation, model)
