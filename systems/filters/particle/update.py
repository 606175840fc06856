"""The measurement update of a cloud: weights, resampling, and where wanted tempering and a kernel."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.filters.particle.draws import Draws
from quietfix.systems.filters.particle.kernel import bandwidth, lost_spread, shrunk_kernel
from quietfix.systems.filters.particle.likelihood import Likelihood
from quietfix.systems.filters.particle.resampling import SCHEMES, parents
from quietfix.systems.filters.particle.tempering import next_exponent
from quietfix.systems.filters.particle.weights import effective_size, moments, normalise
from quietfix.systems.kernels.particles.calls import gather
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
        weight: Array,
        mean: Array,
        covariance: Array,
        draws: Draws,
        which: Index,
        stage: int,
        out: Cloud | None = None,
    ) -> Cloud:
        """Return clouds of equal weights; arguments are those of the trials `which` alone.

        Parameters
        ----------
        cloud : Cloud
            Its weights are not read.
        weight : ndarray, shape (trials, N)
            Weights to be used instead; they sum to 1.
        mean, covariance : ndarray, shapes (trials, n) and (trials, n, n)
            Moments of the weighted cloud.
        draws : Draws
            Random numbers of all trials.
        which : ndarray of int
            Which of those trials these are.
        stage : int
            How many resamplings there were at this instant.
        out : Cloud, optional
            Where the result is put.
        """
        _, n, count = cloud.particles.shape
        scheme = SCHEMES[self.scheme]
        uniform = draws.uniform(f"resample:{stage}", which, 1 if scheme.one_number else count)
        chosen = parents(scheme.counts(weight, uniform))
        fresh = Cloud(*(np.empty_like(array) for array in cloud)) if out is None else out
        fresh.log_weight[...] = 0.0
        if not self.kernel:
            gather(cloud.particles, cloud.ancestor, chosen, fresh.particles, fresh.ancestor)
            return fresh
        kept = np.empty_like(cloud.particles)
        gather(cloud.particles, cloud.ancestor, chosen, kept, fresh.ancestor)
        white = draws.normal(f"kernel:{stage}", which, (n, count))
        widening = lost_spread(effective_size(weight))
        shrunk_kernel(kept, mean, cholesky(covariance), white, bandwidth(n, count), widening, fresh.particles)
        return fresh

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
        residual : ndarray, shape (trials, N, m)
            Of the prior cloud.
        draws : Draws
            Random numbers of these trials.
        out : Cloud, optional
            Where the posterior cloud is put; it shares no memory with the prior.
        """
        trials, _, count = cloud.particles.shape
        active, remaining, stage = np.arange(trials), np.ones(trials), 0
        log_likelihood, white = likelihood(cloud.particles, active, residual)
        # The bootstrap filter has no weights here. (Others may have in some trials and not in others, and a
        # trial's rounding must not depend on its neighbours.)
        equal = self.share is None and math.isinf(self.threshold) and not cloud.log_weight.any()
        prior_weight, before = (None, math.log(count)) if equal else normalise(cloud.log_weight)
        innovation, spread = moments(white.swapaxes(1, 2), prior_weight)
        done = _not_yet(cloud, innovation, spread + np.eye(white.shape[-1]), out)
        del white
        while active.size:
            if stage:
                log_likelihood, _ = likelihood(cloud.particles, active)
                prior_weight, before = None, math.log(count)
            hopeless = ~np.isfinite(log_likelihood.max(axis=-1))
            if hopeless.any():  # no particle can explain it: nothing is learned but that
                log_likelihood = np.where(hopeless[:, None], 0.0, log_likelihood)
                done.log_evidence[active[hopeless]] = -math.inf
            step = self._exponent(log_likelihood, prior_weight, remaining, stage)
            log_weight = cloud.log_weight + step[:, None] * log_likelihood
            weight, log_sum = normalise(log_weight)
            done.log_evidence[active] += log_sum - before
            mean, covariance = moments(cloud.particles, weight)
            effective = effective_size(weight)

            last = step >= remaining
            again = ~last | (effective < self.threshold * count)
            self._finish(done.cloud, active, last & ~again, Cloud(cloud.particles, log_weight, cloud.ancestor))
            for array, value in ((done.mean, mean), (done.covariance, covariance), (done.effective, effective)):
                array[active] = value
            done.stages[active] += 1
            rows = np.flatnonzero(again)
            if rows.size == 0:
                break
            if rows.size < active.size:
                cloud, weight, mean, covariance = cloud.rows(rows), weight[rows], mean[rows], covariance[rows]
                last, step, remaining, active = last[rows], step[rows], remaining[rows], active[rows]
            into = done.cloud if last.all() and active.size == trials else None
            cloud = self.resample(cloud, weight, mean, covariance, draws, active, stage, into)
            if into is None:
                self._finish(done.cloud, active, last, cloud)
            rows = np.flatnonzero(~last)
            active, remaining = active[rows], (remaining - step)[rows]
            if rows.size < last.size:
                cloud = cloud.rows(rows)
            stage += 1
        return done

    def _exponent(self, log_likelihood: Array, weight: Array | None, remaining: Array, stage: int) -> Array:
        """Return the power of the likelihood that each trial takes in this stage; `weight` None: all the same."""
        if self.share is None or stage >= self.max_stages - 1:
            return remaining
        flat = np.full(log_likelihood.shape, 1 / log_likelihood.shape[-1]) if weight is None else weight
        return next_exponent(flat, log_likelihood, remaining, self.share)

    @staticmethod
    def _finish(done: Cloud, active: Index, last: NDArray[np.bool_], cloud: Cloud) -> None:
        """Put the clouds of those trials of `active` that are at their last stage where they belong."""
        if not last.any():
            return
        whole = last.all() and active.size == len(done.particles)  # a slice is copied faster than rows are
        for array, value in zip(done, cloud, strict=True):
            if whole:
                array[...] = value
            else:
                array[active[last]] = value[last]


def _not_yet(cloud: Cloud, innovation: Array, spread: Array, out: Cloud | None) -> Updated:
    """Return an update to be filled in, trial by trial."""
    trials, n, _ = cloud.particles.shape
    return Updated(
        cloud=Cloud(*(np.empty_like(array) for array in cloud)) if out is None else out,
        mean=np.empty((trials, n)),
        covariance=np.empty((trials, n, n)),
        effective=np.empty(trials),
        log_evidence=np.zeros(trials),
        innovation=innovation,
        spread=spread,
        stages=np.zeros(trials),
    )
