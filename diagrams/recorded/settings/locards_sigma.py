r"""How well receivers date messages, from what is left over when each message is located by itself.

A message that m receivers heard gives m - 1 differences and an altitude for three unknowns. Its least cost
:math:`c_i(s)` follows chi-square with :math:`d_i` degrees of freedom where s is the standard deviation of a difference;
whatever s is true, half of the messages then lie below the median of that distribution. So

.. math:: \hat s:\quad \mathrm{median}_i\ \frac{c_i(\hat s)}{\chi^2_{0.5}(d_i)} = 1,

an M-estimate of scale with the breakdown point of the median, one half (Huber and Ronchetti, *Robust Statistics*, 2nd
ed. 2009, section 5.1): gross errors in a fifth of the messages put its place at 62 % of the sound ones and enlarge it
by a fifth. Aircraft's own positions are not read. c falls as s grows, because the altitude keeps its own sigma; the
iteration :math:`s \leftarrow s\,\mathrm{median}^{1/2}` settles in a few steps.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.stats import chi2

from quietfix.systems.constants import SPEED_OF_LIGHT
from quietfix.systems.fixes.snapshot import snapshot_fix, starts_around
from quietfix.systems.measurement.altitude import Altitude
from quietfix.systems.measurement.stack import Stack
from quietfix.systems.measurement.tdoa import Tdoa
from quietfix.systems.sensors.recorded import Recording

__all__ = ["LEAST_MESSAGES", "residual_sigma"]

LEAST_MESSAGES = 25
"""Of two degrees of freedom each: their median tells sigma to 0.72 / sqrt(25), a seventh."""

_STEPS = 20
_SETTLED = 1e-3  # relative; the estimate itself is good to some percent


def residual_sigma(
    recordings: Sequence[Recording],
    sigma: float,
    sigma_altitude: float,
    least: float,
    assumed: tuple[float, float] = (0.0, math.inf),
) -> float | None:
    """Return the standard deviation of a time difference, as a length [m].

    Parameters
    ----------
    recordings : sequence of Recording
        Rows ``tdoa_10`` ... and ``altitude``; every message of every trial counts as one.
    sigma : float
        Where the iteration begins [m].
    sigma_altitude : float
        Of the altitude [m].
    least : float
        The estimate is not made smaller than this [m].
    assumed : (float, float)
        Altitude of messages that report none, and its standard deviation [m]; infinite: those have no such row.

    Returns
    -------
    float or None
        None where fewer than `LEAST_MESSAGES` messages are heard by more receivers than a fix needs.
    """
    trials = recordings[0].measurement.shape[1]
    rows = np.concatenate([one.measurement.reshape(-1, one.measurement.shape[-1]) for one in recordings])
    platforms = np.concatenate([one.platforms for one in recordings])
    places = np.broadcast_to(platforms, (len(platforms), trials, *platforms.shape[2:])).reshape(len(rows), -1, 6)
    silent = np.isnan(rows[:, -1]) if math.isfinite(assumed[1]) else np.zeros(len(rows), dtype=bool)
    rows[silent, -1] = assumed[0]
    height = np.where(np.isfinite(rows[:, -1]), rows[:, -1], 0.0)
    starts = starts_around(places, height)
    for _ in range(_STEPS):
        tdoa = Tdoa(sigma / SPEED_OF_LIGHT, range(1, places.shape[1]), correlated=True)
        model = Stack([tdoa, Altitude(sigma_altitude)])
        noise = model.noise_covariance()
        if silent.any():
            noise = np.repeat(noise[None], len(rows), axis=0)
            noise[silent, -1, -1] = assumed[1] ** 2
        fix = snapshot_fix(rows, places, model, noise, starts)
        told = np.isfinite(fix.cost) & (fix.dof >= 1)
        if np.count_nonzero(told) < LEAST_MESSAGES:
            return None
        ratio = math.sqrt(float(np.median(fix.cost[told] / chi2.median(fix.dof[told]))))
        reached = max(sigma * ratio, least)
        settled = abs(reached - sigma) < _SETTLED * sigma
        sigma = reached
        if settled:
            break
    return sigma
