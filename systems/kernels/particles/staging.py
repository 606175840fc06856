"""The compiled parts of a stage of an update, called with arrays."""

from __future__ import annotations

from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from quietfix.systems.kernels.loading import ready
from quietfix.systems.kernels.updating import plain

__all__ = ["Shares", "Stage", "carried", "exponents", "prior_shares", "renewed", "staged"]

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Mask = NDArray[np.bool_]

_BLOCK = 512  # as in quietfix.systems.kernels.particles.weighing
_NONE_DRAWN, _NONE_GIVEN = np.empty((0, 4), dtype=np.uint64), np.empty((0, 1), dtype=np.int64)


class Shares(NamedTuple):
    """Weights of clouds.

    Attributes
    ----------
    weight : ndarray, shape (trials, N)
        They sum to 1; not set in trials in which they are all `alike`.
    alike : ndarray of bool, shape (trials,)
    log_sum : ndarray, shape (trials,)
        Logarithm of the sum of the weights as they were.
    """

    weight: Array
    alike: Mask
    log_sum: Array

    def all_alike(self) -> Shares:
        """Return the same number of trials in which all particles weigh alike."""
        count = self.weight.shape[-1]
        return Shares(self.weight, np.ones_like(self.alike), np.full_like(self.log_sum, np.log(count)))

    def rows(self, which: Index) -> Shares:
        """Return the first so many trials, alike in all."""
        k = len(which)
        return Shares(self.weight[:k], self.alike[:k], self.log_sum[:k])


class Stage(NamedTuple):
    """Clouds weighed by a power of their likelihoods.

    Attributes
    ----------
    log_weight, weight : ndarray, shape (k, N)
        The weights, the latter of sum 1.
    mean, covariance : ndarray, shapes (k, n) and (k, n, n)
    effective, log_sum : ndarray, shape (k,)
        Effective sample size; logarithm of the sum.
    """

    log_weight: Array
    weight: Array
    mean: Array
    covariance: Array
    effective: Array
    log_sum: Array


def prior_shares(log_weight: Array) -> Shares:
    """Return what weights (trials, N) are given by their logarithms."""
    trials = len(log_weight)
    found = Shares(np.empty(log_weight.shape), np.empty(trials, dtype=bool), np.empty(trials))
    ready("particles.stages:weights")(plain(log_weight), *found)
    return found


def exponents(log_likelihood: Array, highest: Array, shares: Shares, remaining: Array, share: float) -> Array:
    """Return powers (trials,); see `quietfix.systems.filters.particle.tempering.next_exponent`."""
    chosen = np.empty(len(remaining))
    given = plain(log_likelihood), highest, plain(shares.weight), shares.alike, plain(remaining)
    ready("particles.stages:exponents")(*given, share, chosen)
    return chosen


def staged(particles: Array, log_weight: Array, which: Index, alike: Mask, log_likelihood: Array, step: Array) -> Stage:
    """Weigh the clouds (all, n, N) of `which` (k,) trials; see `quietfix.systems.kernels.particles.stages.stage`."""
    _, n, count = particles.shape
    k = len(which)
    found = Stage(
        np.empty((k, count)), np.empty((k, count)), np.empty((k, n)), np.empty((k, n, n)), np.empty(k), np.empty(k)
    )
    given = plain(particles), plain(log_weight), which, alike, plain(log_likelihood), plain(step)
    ready("particles.stages:stage")(*given, np.empty((n + 1, _BLOCK)), *found)
    return found


def renewed(
    cloud: tuple[Array, Array],
    which: Index,
    weight: Array,
    points: Array | NDArray[np.int64],
    kernel: tuple[Array, Array, float, NDArray[np.uint64]] | None,
    out: tuple[Array, Array, Array],
) -> None:
    """Resample the clouds of `which` (k,) trials into others; see `quietfix.systems.kernels.particles.choosing.renew`.

    Parameters
    ----------
    cloud : tuple of ndarray
        Particles (all, n, N) and ancestors (all, N).
    which : ndarray of int, shape (k,)
    weight : ndarray, shape (k, N)
    points : ndarray, shape (k, 1) or, of int, (k, N)
        The number that places the points of systematic resampling, or how often each particle is taken.
    kernel : tuple, optional
        Mean (k, n), root of the covariance (k, n, n), shrinkage and states (k, 4) of generators.
    out : tuple of ndarray
        Particles, ancestors and logarithms of weights (all, N); they may be those of the cloud.
    """
    _, n, count = cloud[0].shape
    counted = points.dtype == np.int64
    uniform = np.empty((0, 1)) if counted else plain(cast(Array, points))
    given = cast(NDArray[np.int64], points) if counted else _NONE_GIVEN
    shrunk = (np.empty((0, n)), np.empty((0, n, n)), 1.0, _NONE_DRAWN) if kernel is None else kernel
    space = np.empty((2, count), dtype=np.int64), np.empty((2, n, count))
    mean, root, *rest = shrunk
    apart = not np.may_share_memory(cloud[0], out[0])
    arguments = which, plain(weight), uniform, given, plain(mean), plain(root), *rest, apart
    ready("particles.choosing:renew")(plain(cloud[0]), plain(cloud[1]), *arguments, *space, *out)


def carried(cloud: tuple[Array, Array], which: Index, out: tuple[Array, Array]) -> None:
    """Copy particles and ancestors of `which` trials to the same trials of another cloud."""
    ready("particles.choosing:carry")(plain(cloud[0]), plain(cloud[1]), which, *out)
