"""Whether a cloud still stands for the posterior: unique ancestors, and evidence against what is expected of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["COLUMNS", "LEAST_EVIDENCE", "MEMORY", "evidence", "follow", "normalised_innovation"]

Array = NDArray[np.float64]

COLUMNS = ("effective_particles", "ancestors", "evidence", "recent_evidence", "diverged", "stages", "restarts", "age")
"""What is kept of every trial."""

MEMORY = 10.0
"""Epochs over which the evidence is averaged."""

LEAST_EVIDENCE = -3.0
"""Recent evidence below which a cloud has diverged. That of a right filter with m rows has mean 0 and standard
deviation sqrt(m / 2 / (2 MEMORY - 1)), which is 0.32 for four rows: nine of these."""

_FLOOR = -20.0  # of one epoch's evidence: one outlier alone, however large, is no divergence


def normalised_innovation(innovation: Array, spread: Array) -> Array:
    r"""Return :math:`\nu^T S^{-1} \nu`, shape (trials,), of innovations (trials, m) with covariances (trials, m, m)."""
    return np.einsum("ti,ti->t", innovation, np.linalg.solve(spread, innovation[..., None])[..., 0])


def evidence(log_evidence: Array, spread: Array, rows: Array) -> Array:
    r"""Return how much more likely the measurement is than is expected, as a logarithm, shape (trials,).

    .. math:: \log p(z \mid \text{past}) - E, \qquad E = -\tfrac12\log\det(2\pi S) - \tfrac m2

    E is the expected logarithm of the likelihood of a Gaussian prediction with covariance S. For a filter that is right
    the difference is about :math:`(m - \chi^2_m)/2`; for a cloud that has left the truth behind it is below that by
    half the square of the distance in standard deviations. Effective sample size does not see this: after a collapse
    all particles are alike, and it is high.

    Parameters
    ----------
    log_evidence : ndarray, shape (trials,)
        Of the whitened measurement, without its constant.
    spread : ndarray, shape (trials, m, m)
        S of the whitened measurement; unit rows where one is missing.
    rows : ndarray, shape (trials,)
        m: rows used.
    """
    return log_evidence + 0.5 * np.linalg.slogdet(spread)[1] + 0.5 * rows


def follow(recent: Array, now: Array) -> Array:
    """Return the recent evidence (trials,) with that of another epoch."""
    return recent + (np.maximum(now, _FLOOR) - recent) / MEMORY
