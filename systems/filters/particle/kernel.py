"""Kernels that make particles of one parent different again."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.particles.calls import moved

__all__ = ["bandwidth", "lost_spread", "shrunk_kernel"]

Array = NDArray[np.float64]


def bandwidth(n: int, particles: int) -> float:
    """Return the optimal width of a Gaussian kernel for a Gaussian density, ``(4 / ((n + 2) N))^(1 / (n + 4))``.

    Silverman, *Density Estimation for Statistics and Data Analysis*, 1986, eq. (4.14); at most 1.
    """
    return min(1.0, (4 / ((n + 2) * particles)) ** (1 / (n + 4)))


def lost_spread(effective: Array) -> Array:
    r"""Return by what share a weighted covariance is too small, :math:`1/(N_e - 1)`, shape (trials,), at most 1.

    It is about the weighted mean, which has a share :math:`1/N_e` of the variance itself. Left alone, that eats up the
    spread of what is hardly observed in some hundred resamplings.

    Parameters
    ----------
    effective : ndarray, shape (trials,)
        N_e, the effective sample size.
    """
    return 1 / np.maximum(effective - 1, 1.0)


def shrunk_kernel(
    cloud: Array, mean: Array, root: Array, white: Array, width: float, widening: Array, out: Array | None = None
) -> Array:
    r"""Draw from a kernel density of the cloud without widening it more than is asked for.

    .. math:: x_i \leftarrow \bar x + a\,(x_i - \bar x) + \sqrt{h^2 + \delta}\,L\,e_i, \qquad a = \sqrt{1 - h^2}

    Liu and West, *Combined parameter and state estimation in simulation-based filtering*, in Doucet et al., *Sequential
    Monte Carlo Methods in Practice*, 2001, 197-223: a kernel without the shrinkage would add :math:`h^2 P` to the
    covariance each time.

    Parameters
    ----------
    cloud : ndarray, shape (trials, n, N)
        Equal weights.
    mean : ndarray, shape (trials, n)
        Of the cloud.
    root : ndarray, shape (trials, n, n)
        L, of its covariance.
    white : ndarray, shape (trials, n, N)
        Standard normal.
    width : float
        h, from 0 to 1.
    widening : ndarray, shape (trials,)
        delta: the covariance becomes (1 + delta) P; see `lost_spread`.
    out : ndarray, shape (trials, n, N), optional
        Where the result is put; it shares no memory with the cloud.
    """
    shrink = math.sqrt(1 - width**2)
    scaled = np.sqrt(width**2 + widening)[:, None, None] * root
    return moved(cloud, shrink * np.eye(mean.shape[-1]), (1 - shrink) * mean, scaled, white, out)
