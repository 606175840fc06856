"""A position that was solved for a target at rest, when the target may move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["with_unknown_velocity"]

Array = NDArray[np.float64]


def with_unknown_velocity(covariance: Array, slope: Array, sigma_velocity: float) -> Array:
    r"""Return the covariance of position and velocity, the velocity being 0 with a spread.

    A fix that takes the velocity as zero has, besides its own error e, that of the velocity:
    :math:`\hat p - p = e - A v`, A its `slope`, so that with :math:`v \sim N(0, \sigma^2 I)`

    .. math:: P = \begin{bmatrix} P_e + \sigma^2 A A^T & \sigma^2 A \\ \sigma^2 A^T & \sigma^2 I \end{bmatrix}.

    Parameters
    ----------
    covariance : ndarray, shape (..., 3, 3)
        P_e, of the fix of a target whose velocity is known [m^2].
    slope : ndarray, shape (..., 3, 3)
        A = dp/dv at given measurements [s]; zeros where no measurement depends on the velocity.
    sigma_velocity : float
        Standard deviation of the velocity per axis [m/s].

    Returns
    -------
    ndarray, shape (..., 6, 6)
    """
    both = np.zeros((*covariance.shape[:-2], 6, 6))
    both[..., 3:, 3:] = sigma_velocity**2 * np.eye(3)
    both[..., :3, :3] = covariance
    if slope.any():
        cross = sigma_velocity**2 * slope
        both[..., :3, :3] += cross @ np.swapaxes(slope, -1, -2)
        both[..., :3, 3:], both[..., 3:, :3] = cross, np.swapaxes(cross, -1, -2)
    return both
