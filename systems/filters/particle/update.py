"""The measurement update of a cloud: weights, resampling, and where wanted tempering and a kernel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.filters.particle.draws import Draws
from quietfix.systems.filters.particle.kernel import bandwidth, lost_spread
from quietfix.systems.filters.particle.likelihood import Likelihood
from quietfix.systems.filters.particle.resampling import SCHEMES
from quietfix.systems.filters.particle.weights import definite
from quietfix.systems.kernels.particles.calls import Look
from quietfix.systems.kernels.particles.staging import Shares, carried, exponents, prior_shares, renewed, staged
from quietfix.systems.linear_algebra import cholesky

__all__ = ["Cloud", "ParticleUpdate", "Updated"]

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class Cloud(NamedTuple):
    """Particles of some trials.

    Attributes
    ----------
    particles : ndarray, shape (trials, n, N)
    log_weight : ndarray, shape (trials, N)
        Up to a constant.
    ancestor : ndarray, shape (trials, N)
        Which particle of an earlier instant each comes from; rising.
    """

    particles: Array
    log_weight: Array
    ancestor: Array

    def rows(self, which: Index) -> Cloud:
        """Return some trials, as a copy."""
        return Cloud(*(array[which] for array in self))


class Updated(NamedTuple):
    """What an update gives.

    Attributes
    ----------
    cloud : Cloud
    mean, covariance : ndarray, shapes (trials, n) and (trials, n, n)
        Moments of the weighted cloud, before the last resampling: resampling only adds noise to them.
    effective : ndarray, shape (trials,)
        Effective sample size there.
    log_evidence : ndarray, shape (trials,)
        Logarithm of the predictive likelihood of the whitened measurement, without its constant.
    residual : ndarray, shape (trials, m)
        Mean residual of the predicted cloud.
    innovation : ndarray, shape (trials, m)
        Whitened mean residual of the predicted cloud.
    spread : ndarray, shape (trials, m, m)
        Its covariance, noise included.
    stages : ndarray, shape (trials,)
        Tempering stages.
    """

    cloud: Cloud
    mean: Array
    covariance: Array
    effective: Array
    log_evidence: Array
    residual: Array
    innovation: Array
    spread: Array
    stages: Array


@dataclass(frozen=True)
class ParticleUpdate:
    """Weight by the likelihood and resample; temper and jitter where asked.

    With the defaults it is progressive correction (Musso, Oudjane and Le Gland, 2001; Oudjane and Musso, *Progressive
    correction for regularized particle filters*, FUSION 2000): the likelihood is taken in powers small enough that
    half of the particles count, and after each power the cloud is resampled and drawn anew from a shrunk kernel. With
    ``share=None, kernel=False, threshold=math.inf`` it is the bootstrap filter of Gordon, Salmond and Smith (1993).

    Parameters
    ----------
    share : float or None
        Effective share of the particles that a stage must keep, between 0 and 1; None: the whole likelihood at once.
    kernel : bool
        Draw from a shrunk kernel after every resampling.
    threshold : float
        Resample after the last stage where the effective share is smaller than this; inf: always.
    scheme : str
        Name in `SCHEMES`.
    max_stages : int
        The last of so many stages takes all that remains.
    """

    share: float | None = 0.5
    kernel: bool = True
    threshold: float = 0.5
    scheme: str = "systematic"
    max_stages: int = 50

    def __post_init__(self) -> None:
        """Check the arguments."""
        if self.share is not None and not 0 < self.share < 1:
            raise ValueError(f"share: {self.share} is not allowed; a number > 0 and < 1")
        if not self.threshold > 0:
            raise ValueError(f"threshold: {self.threshold} is not allowed; a number > 0")
        if self.scheme not in SCHEMES:
            raise ValueError(f"resampling: {self.scheme} is not allowed; one of {', '.join(SCHEMES)}")
        if self.max_stages < 1:
            raise ValueError(f"max_stages: {self.max_stages} is not allowed; a whole number >= 1")

    def resample(
        self,
        cloud: Cloud,
        which: Index,
        weight: Array,
        mean: Array,
        covariance: Array,
        effective: Array,
        draws: Draws,
        stage: int,
        out: Cloud,
    ) -> None:
        """Put clouds of equal weights in the place of those of some trials.

        Parameters
        ----------
        cloud : Cloud
            Of all trials; its weights are not read.
        which : ndarray of int, shape (k,)
            Which trials.
        weight : ndarray, shape (k, N)
            Their weights, which sum to 1.
        mean, covariance : ndarray, shapes (k, n) and (k, n, n)
            Moments of the weighted clouds.
        effective : ndarray, shape (k,)
            Their effective sample sizes.
        draws : Draws
            Random numbers of all trials.
        stage : int
            How many resamplings there were at this instant.
        out : Cloud
            Where the result is put, of all trials; it may be the cloud itself.
        """
        _, n, count = cloud.particles.shape
        scheme = SCHEMES[self.scheme]
        points = draws.uniform(f"resample:{stage}", which, 1 if scheme.one_number else count)
        drawn = None
        if self.kernel:
            width, states = bandwidth(n, count), draws.generators(f"kernel:{stage}", which)
            root = np.sqrt(width**2 + lost_spread(effective))[:, None, None] * cholesky(covariance)
            drawn = mean, root, math.sqrt(1 - width**2), states
        taken = points if scheme.one_number else scheme.counts(weight, points)
        into = out.particles, out.ancestor, out.log_weight
        renewed((cloud.particles, cloud.ancestor), which, weight, taken, drawn, into)

    def __call__(
        self, cloud: Cloud, likelihood: Likelihood, residual: Array, draws: Draws, out: Cloud | None = None
    ) -> Updated:
        """Return the posterior of every trial.

        A trial's stages do not depend on the others': one that is done is not touched again.

        Parameters
        ----------
        cloud : Cloud
            Prior, finite.
        likelihood : Likelihood
            Of what was measured.
        residual : ndarray, shape (trials, m, N)
            Of the prior cloud.
        draws : Draws
            Random numbers of these trials.
        out : Cloud, optional
            Where the posterior cloud is put; it shares no memory with the prior.
        """
        trials, _, count = cloud.particles.shape
        active, remaining, stage = np.arange(trials), np.ones(trials), 0
        shares = prior_shares(cloud.log_weight)
        seen = likelihood.look(residual, shares)
        done, logarithm, highest = _not_yet(cloud, seen, out), seen.logarithm, seen.highest
        while active.size:
            if stage:
                logarithm, highest = likelihood(done.cloud.particles, active)
                shares = shares.all_alike().rows(active)
            hopeless = highest == -math.inf
            if hopeless.any():  # no particle can explain it: nothing is learned but that
                logarithm[hopeless], highest[hopeless] = 0.0, 0.0
                done.log_evidence[active[hopeless]] = -math.inf
            step = self._exponent(logarithm, highest, shares, remaining, stage)
            now = staged(cloud.particles, cloud.log_weight, active, shares.alike, logarithm, step)
            covariance = definite(now.covariance)
            done.log_evidence[active] += now.log_sum - shares.log_sum
            done.mean[active], done.covariance[active] = now.mean, covariance
            done.effective[active] = now.effective
            done.stages[active] += 1

            last = step >= remaining
            again = ~last | (now.effective < self.threshold * count)
            self._finish(done.cloud, active[~again], cloud, now.log_weight[~again] if not again.all() else None)
            rows = np.flatnonzero(again)
            if rows.size:
                some = (now.weight, now.mean, covariance, now.effective)
                if rows.size < active.size:
                    some = (some[0][rows], some[1][rows], some[2][rows], some[3][rows])
                self.resample(cloud, active[rows], *some, draws, stage, done.cloud)
            left = np.flatnonzero(~last)
            active, remaining = active[left], (remaining - step)[left]
            cloud = done.cloud
            stage += 1
        return done

    def _exponent(self, logarithm: Array, highest: Array, shares: Shares, remaining: Array, stage: int) -> Array:
        """Return the power of the likelihood that each trial takes in this stage."""
        if self.share is None or stage >= self.max_stages - 1:
            return remaining
        return exponents(logarithm, highest, shares, remaining, self.share)

    @staticmethod
    def _finish(done: Cloud, which: Index, cloud: Cloud, log_weight: Array | None) -> None:
        """Put the clouds of trials that are not resampled after their last stage where they belong."""
        if log_weight is None:
            return
        done.log_weight[which] = log_weight
        if cloud is not done:
            carried((cloud.particles, cloud.ancestor), which, (done.particles, done.ancestor))


def _not_yet(cloud: Cloud, seen: Look, out: Cloud | None) -> Updated:
    """Return an update to be filled in, trial by trial."""
    trials, n, _ = cloud.particles.shape
    return Updated(
        cloud=Cloud(*(np.empty_like(array) for array in cloud)) if out is None else out,
        mean=np.empty((trials, n)),
        covariance=np.empty((trials, n, n)),
        effective=np.empty(trials),
        log_evidence=np.zeros(trials),
        residual=seen.residual,
        innovation=seen.innovation,
        spread=definite(seen.spread) + np.eye(seen.spread.shape[-1]),
        stages=np.zeros(trials),
    )
